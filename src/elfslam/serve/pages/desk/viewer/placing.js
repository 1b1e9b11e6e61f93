// Dragging a floor plan into place: its corners stretch it, its knob turns it, the rest moves it.

import { handlesOf, HANDLE_PX } from "./marks.js";
import { corners, isOnPlan, middle, moved, stretched, turned } from "../../shared/map/placement.js";
import { toMap } from "../../shared/map/projection.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("../../shared/map/placement.js").Placement} Placement */
/** @typedef {import("./state.js").State} State */

/**
 * What a drag that begins here does to the plan: each later place of the finger gives a placement.
 * @param {State} state @param {Point} at_px @param {number} reach_px
 * @returns {((to_px: Point) => Placement) | null} null where it would move the map instead
 */
export function grabPlan(state, at_px, reach_px) {
  const { plan, view, size } = state;
  if (!plan || !state.placing) return null;
  const { placement, aspect } = plan;
  const start_m = toMap(view, size, at_px);
  const reach = Math.max(reach_px, HANDLE_PX);
  const near = (/** @type {Point} */ [x, y]) => Math.hypot(x - at_px[0], y - at_px[1]) <= reach;
  const handles = handlesOf(state);
  const here = (/** @type {Point} */ to_px) => toMap(view, size, to_px);
  if (near(handles.knob)) return (to_px) => turned(placement, aspect, headingOf(placement, aspect, start_m, here(to_px)));
  const corner = handles.corners.findIndex(near);
  if (corner >= 0) {
    const off = offset(corners(placement, aspect)[corner], start_m);
    return (to_px) => stretched(placement, aspect, corner, plus(here(to_px), off));
  }
  if (!isOnPlan(placement, aspect, start_m)) return null;
  return (to_px) => moved(placement, offset(here(to_px), start_m));
}

/** The heading after a finger went round the middle from one place to another. @param {Placement} placement
 * @param {number} aspect @param {Point} from_m @param {Point} to_m */
function headingOf(placement, aspect, from_m, to_m) {
  const [cx, cy] = middle(placement, aspect);
  const angle = (/** @type {Point} */ [x, y]) => Math.atan2(y - cy, x - cx);
  return snapped(placement.heading_rad + angle(to_m) - angle(from_m));
}

/** Plans mostly lie square: within a degree of it they are put square. @param {number} heading_rad */
export function snapped(heading_rad) {
  const quarter = Math.PI / 2;
  const square = Math.round(heading_rad / quarter) * quarter;
  return Math.abs(heading_rad - square) < Math.PI / 180 ? square : heading_rad;
}

/** @param {Point} to @param {Point} from @returns {Point} */
function offset(to, from) {
  return [to[0] - from[0], to[1] - from[1]];
}

/** @param {Point} one @param {Point} other @returns {Point} */
function plus(one, other) {
  return [one[0] + other[0], one[1] + other[1]];
}

// What lies on top of the map: located walks, what is under the finger, the handles of a plan.

import { dot } from "../../shared/map/ground.js";
import { corners, middle } from "../../shared/map/placement.js";
import { drawPointsOfInterest } from "../../shared/map/points_of_interest.js";
import { toScreen } from "../../shared/map/projection.js";
import { placesOf } from "./georeferencing.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("./state.js").State} State */
/** @typedef {ReturnType<typeof import("./state.js").paletteOf>} Palette */

export const HANDLE_PX = 9;
const KNOB_PX = 34;

/** @param {CanvasRenderingContext2D} context @param {import("./scene.js").Scene} scene
 * @param {State} state @param {Palette} palette */
export function drawMarks(context, scene, state, palette) {
  if (state.layers.fixes) state.located.filter((walk) => walk.shown).forEach((walk) => drawLocated(context, walk, state, palette));
  if (state.layers.points) drawPointsOfInterest(context, state, state.points, palette, state.point);
  drawFocus(context, scene, state, palette);
  if (state.placing && state.plan) drawHandles(context, state, palette);
  if (state.tie && state.plan) drawTie(context, state, palette);
}

/** @param {CanvasRenderingContext2D} context @param {import("./state.js").Located} located
 * @param {State} state @param {Palette} palette */
function drawLocated(context, { fixes }, { view, size }, palette) {
  const placed = fixes.filter((fix) => fix.xy_m !== null);
  const at_px = placed.map((fix) => toScreen(view, size, /** @type {Point} */ (fix.xy_m)));
  context.setLineDash([2, 5]);
  context.strokeStyle = palette.ink;
  context.lineWidth = 1.5;
  context.beginPath();
  at_px.forEach(([x, y], at) => (at === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
  context.stroke();
  context.setLineDash([]);
  placed.forEach((fix, at) => mark(context, at_px[at], fix.status, palette));
}

/** A disc where located, a triangle where in doubt, a square where unknown: not by colour alone.
 * @param {CanvasRenderingContext2D} context @param {Point} at_px @param {string} status
 * @param {Palette} palette */
export function mark(context, [x, y], status, palette) {
  const r = 5;
  context.beginPath();
  if (status === "OK") context.arc(x, y, r, 0, 2 * Math.PI);
  else if (status === "AMBIGUOUS") polygon(context, [[x, y - r - 1], [x + r + 1, y + r], [x - r - 1, y + r]]);
  else polygon(context, [[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]]);
  context.lineWidth = 1.5;
  context.fillStyle = palette.status[status] ?? palette.soft;
  context.strokeStyle = palette.surface;
  context.fill();
  context.stroke();
}

/** @param {CanvasRenderingContext2D} context @param {Point[]} points */
function polygon(context, points) {
  points.forEach(([x, y], at) => (at === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
  context.closePath();
}

/** Where the focus lies and how sure that is. @param {import("./scene.js").Scene} scene
 * @param {State} state @returns {{xy_m: Point, sigma_m: number | null} | null} */
export function focusPlace(scene, { focus, located }) {
  if (focus?.kind === "step") {
    const walk = scene.walks[focus.walk];
    return { xy_m: walk.xy_m[focus.step], sigma_m: walk.sigma_m?.[focus.step] ?? null };
  }
  if (focus?.kind === "fix") {
    const fix = located[focus.located].fixes[focus.fix];
    return fix.xy_m && { xy_m: fix.xy_m, sigma_m: fix.sigma_m };
  }
  return null;
}

/** @param {CanvasRenderingContext2D} context @param {import("./scene.js").Scene} scene
 * @param {State} state @param {Palette} palette */
function drawFocus(context, scene, state, palette) {
  const place = focusPlace(scene, state);
  if (!place) return;
  const at_px = toScreen(state.view, state.size, place.xy_m);
  if (place.sigma_m !== null) {
    context.beginPath();
    context.arc(...at_px, Math.max(place.sigma_m * state.view.px_per_m, 1), 0, 2 * Math.PI);
    context.setLineDash([4, 4]);
    context.strokeStyle = palette.ink;
    context.lineWidth = 1.5;
    context.stroke();
    context.setLineDash([]);
  }
  context.lineWidth = 3;
  dot(context, at_px, 6, palette.accent, palette.surface);
}

/** The four corners, and the knob that turns. @param {State} state @returns {{corners: Point[], knob: Point, top: Point}} */
export function handlesOf({ plan, view, size }) {
  if (!plan) return { corners: [], knob: [0, 0], top: [0, 0] };
  const places = corners(plan.placement, plan.aspect).map((xy) => toScreen(view, size, xy));
  const [cx, cy] = toScreen(view, size, middle(plan.placement, plan.aspect));
  const top = /** @type {Point} */ ([(places[2][0] + places[3][0]) / 2, (places[2][1] + places[3][1]) / 2]);
  const away = Math.hypot(top[0] - cx, top[1] - cy) || 1;
  const knob = /** @type {Point} */ ([
    top[0] + ((top[0] - cx) / away) * KNOB_PX, top[1] + ((top[1] - cy) / away) * KNOB_PX]);
  return { corners: places, knob, top };
}

/** @param {CanvasRenderingContext2D} context @param {State} state @param {Palette} palette */
function drawHandles(context, state, palette) {
  const { corners: places, knob, top } = handlesOf(state);
  context.strokeStyle = palette.accent;
  context.lineWidth = 1.5;
  context.setLineDash([5, 4]);
  context.beginPath();
  polygon(context, places);
  context.moveTo(...top);
  context.lineTo(...knob);
  context.stroke();
  context.setLineDash([]);
  context.lineWidth = 2.5;
  for (const [x, y] of places) {
    context.beginPath();
    context.rect(x - HANDLE_PX + 2, y - HANDLE_PX + 2, 2 * HANDLE_PX - 4, 2 * HANDLE_PX - 4);
    context.fillStyle = palette.surface;
    context.fill();
    context.stroke();
  }
  dot(context, knob, HANDLE_PX - 1, palette.surface, palette.accent);
}

/** The places by which a plan is tied, numbered: discs on the plan, rings on the map, a line between.
 * @param {CanvasRenderingContext2D} context @param {State} state @param {Palette} palette */
function drawTie(context, { tie, plan, view, size }, palette) {
  if (!tie || !plan) return;
  const places = placesOf(tie, plan.placement).map((xy) => toScreen(view, size, xy));
  const others = (tie.kind === "length" ? places.slice(1) : tie.map.map((xy) => toScreen(view, size, xy)));
  context.strokeStyle = palette.accent;
  context.lineWidth = 2;
  others.forEach((other, at) => {
    context.beginPath();
    polygon(context, [places[at], other]);
    context.stroke();
  });
  context.lineWidth = 3;
  others.forEach((other) => dot(context, other, 9, "transparent", palette.accent));
  context.font = "650 15px system-ui, sans-serif";
  places.forEach((place, at) => {
    dot(context, place, 6, palette.accent, palette.surface);
    context.fillStyle = palette.ink;
    context.fillText(String(at + 1), place[0] + 11, place[1] - 9);
  });
}

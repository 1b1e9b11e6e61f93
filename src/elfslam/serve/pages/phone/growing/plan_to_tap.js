/** A floor plan on a canvas, on which the walker taps where they stand. */

import { h } from "../../shared/dom.js";
import { onGestures } from "../../shared/map/gestures.js";
import { density, drawGrid, drawPlan, mountSurface, zoomButtons } from "../../shared/map/ground.js";
import { corners } from "../../shared/map/placement.js";
import { drawPointsOfInterest } from "../../shared/map/points_of_interest.js";
import { boundsOf, fit, toMap } from "../../shared/map/projection.js";
import { t } from "../../shared/words.js";
import { paletteOf } from "../locating/place_map.js";

/**
 * @typedef {import("../../shared/map/projection.js").Point} Point
 * @typedef {import("../../shared/map/points_of_interest.js").PointOfInterest} PointOfInterest
 */

const HELP = t("Tap where you stand. Drag or arrow keys move the plan, plus and minus zoom, Enter takes its middle.");
const MARGIN_PX = 12;
/** A tap this near to a place that has a name means that place. */
const NEAR_M = 1.5;

/**
 * @param {HTMLElement} stage that gets the canvas @param {import("../../shared/map/ground.js").Plan} plan
 * @param {PointOfInterest[]} named places that have a name already @param {(xyM: Point) => void} tapped
 */
export function mountPlanToTap(stage, plan, named, tapped) {
  const bounds = /** @type {[number, number, number, number]} */ (boundsOf(corners(plan.placement, plan.aspect)));
  const size = { width: 340, height: 260 };
  const shown = { view: fit(bounds, size, MARGIN_PX), size, plan };
  let palette = paletteOf(document.documentElement);
  let points = named;
  /** @type {PointOfInterest | null} */
  let pin = null;
  const canvas = h("canvas", { tabindex: "0", role: "application", "aria-roledescription": t("floor plan"), "aria-label": HELP });

  function paint() {
    const context = canvas.getContext("2d");
    context.setTransform(density(), 0, 0, density(), 0, 0);
    context.clearRect(0, 0, shown.size.width, shown.size.height);
    drawGrid(context, shown, palette);
    drawPlan(context, shown);
    drawPointsOfInterest(context, shown, pin ? [...points, pin] : points, palette, pin);
  }

  /** @param {Point} atPx */
  function take(atPx) {
    const [x_m, y_m] = toMap(shown.view, shown.size, atPx);
    pin = { name: "", kind: "other", x_m, y_m };
    tapped([x_m, y_m]);
    redraw();
  }

  const hands = {
    look: () => shown,
    turnTo: (/** @type {typeof shown.view} */ view) => {
      shown.view = view;
      redraw();
    },
    fit: () => hands.turnTo(fit(bounds, shown.size, MARGIN_PX)),
    tap: take, point() {}, leave() {}, grab: () => null, drop() {}, step() {},
  };
  onGestures(canvas, hands);
  canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.key === "Enter") take([shown.size.width / 2, shown.size.height / 2]);
  });
  const { redraw, leave } = mountSurface(canvas, {
    paint,
    resized(now) {
      shown.size = now;
      shown.view = fit(bounds, now, MARGIN_PX);
    },
    recoloured: () => {
      palette = paletteOf(document.documentElement);
    },
  });
  stage.replaceChildren(canvas, zoomButtons(hands));
  /** What was tapped last has its name now. @param {string} name */
  const settle = (name) => {
    if (pin) points = [...points.filter((each) => each.name !== name), { ...pin, name }];
    pin = null;
    redraw();
  };
  return { leave, settle };
}

/** The place with a name that a tap means, if any. @param {PointOfInterest[]} points @param {Point} xyM */
export function placeAt(points, [x, y]) {
  const away = (/** @type {PointOfInterest} */ { x_m, y_m }) => Math.hypot(x_m - x, y_m - y);
  const [nearest] = [...points].sort((one, other) => away(one) - away(other));
  return nearest && away(nearest) <= NEAR_M ? nearest : null;
}

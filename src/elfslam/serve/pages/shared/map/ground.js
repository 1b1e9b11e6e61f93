// What every map is drawn on: the grid, the floor plan, and lines whose width is in pixels.

import { imageMatrix } from "./placement.js";
import { isNegative } from "./plan_image.js";
import { scaleBar, toMap, toScreen } from "./projection.js";

/** @typedef {import("./projection.js").Point} Point */
/** @typedef {{view: import("./projection.js").View, size: import("./projection.js").Size}} Look */
/** @typedef {{placement: import("./placement.js").Placement, aspect: number, inverted: boolean | null,
 *   image: CanvasImageSource, negative: CanvasImageSource}} Plan */

const GRID_PX = 90;

/** From here on the canvas counts in metres, y up. @param {CanvasRenderingContext2D} context
 * @param {Look} look @param {number} density device pixels per pixel */
export function inMetres(context, { view, size }, density) {
  const scale = density * view.px_per_m;
  const [x, y] = toScreen(view, size, [0, 0]);
  context.setTransform(scale, 0, 0, -scale, x * density, y * density);
  context.lineCap = context.lineJoin = "round";
}

/** A path in metres. @param {CanvasRenderingContext2D} context @param {Path2D} path
 * @param {string} colour @param {number} width_px @param {Look} look @param {number} [alpha] */
export function stroke(context, path, colour, width_px, { view }, alpha = 1) {
  context.globalAlpha = alpha;
  context.strokeStyle = colour;
  context.lineWidth = width_px / view.px_per_m;
  context.stroke(path);
  context.globalAlpha = 1;
}

/** Faint lines, a round number of metres apart. @param {CanvasRenderingContext2D} context
 * @param {Look} look @param {{line: string}} palette */
export function drawGrid(context, { view, size }, palette) {
  const { length_m } = scaleBar(view.px_per_m, 2 * GRID_PX);
  const [left, top] = toMap(view, size, [0, 0]);
  const [right, bottom] = toMap(view, size, [size.width, size.height]);
  context.beginPath();
  for (let x = Math.ceil(left / length_m); x * length_m < right; x += 1) {
    const [x_px] = toScreen(view, size, [x * length_m, 0]);
    context.moveTo(Math.round(x_px) + 0.5, 0);
    context.lineTo(Math.round(x_px) + 0.5, size.height);
  }
  for (let y = Math.ceil(bottom / length_m); y * length_m < top; y += 1) {
    const [, y_px] = toScreen(view, size, [0, y * length_m]);
    context.moveTo(0, Math.round(y_px) + 0.5);
    context.lineTo(size.width, Math.round(y_px) + 0.5);
  }
  context.strokeStyle = palette.line;
  context.globalAlpha = 0.55;
  context.lineWidth = 1;
  context.stroke();
  context.globalAlpha = 1;
}

/** @param {CanvasRenderingContext2D} context @param {Look & {plan: Plan | null}} state */
export function drawPlan(context, { plan, view, size }) {
  if (!plan) return;
  const matrix = imageMatrix(plan.placement, plan.aspect, (xy) => toScreen(view, size, xy));
  context.save();
  context.globalAlpha = plan.placement.opacity;
  context.imageSmoothingQuality = "high";
  context.transform(...matrix);
  context.drawImage(isNegative(plan) ? plan.negative : plan.image, 0, 0, 1, 1);
  context.restore();
}

/** @param {CanvasRenderingContext2D} context @param {Point} at_px @param {number} radius_px
 * @param {string} inside @param {string} around */
export function dot(context, [x, y], radius_px, inside, around) {
  context.beginPath();
  context.arc(x, y, radius_px, 0, 2 * Math.PI);
  context.fillStyle = inside;
  context.strokeStyle = around;
  context.fill();
  context.stroke();
}

/** Device pixels per pixel, as far as they are worth drawing. */
export function density() {
  return Math.min(window.devicePixelRatio || 1, 2);
}

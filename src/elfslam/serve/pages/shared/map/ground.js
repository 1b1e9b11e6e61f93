// What every map is drawn on: the grid, the floor plan, and lines whose width is in pixels.

import { h, icon } from "../dom.js";
import { formatMetres } from "../format.js";
import { t } from "../words.js";
import { imageMatrix } from "./placement.js";
import { scaleBar, toMap, toScreen, zoomAt } from "./projection.js";

/** @typedef {import("./projection.js").Point} Point */
/** @typedef {{view: import("./projection.js").View, size: import("./projection.js").Size}} Look */
/** @typedef {{placement: import("./placement.js").Placement, aspect: number, inverted: boolean | null,
 *   image: CanvasImageSource, negative: CanvasImageSource}} Plan
 */

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

// What every map on a canvas has: it is drawn anew when something has changed, its size or the page's
// colours among it; buttons that zoom; a bar that says how long a metre is.

/** @typedef {import("./projection.js").View} View */
/** @typedef {import("./projection.js").Size} Size */

const BAR_PX = 140;
const ZOOM = 1.5;

/**
 * @template P
 * @param {HTMLCanvasElement} canvas
 * @param {{paletteOf: () => P, paint: (palette: P) => void, resized: (size: Size) => void}} told
 * @returns {{redraw: () => void, leave: () => void}} redraw: before the next frame is shown
 */
export function mountSurface(canvas, { paletteOf, paint, resized }) {
  let palette = paletteOf();
  let frame = 0;
  const redraw = () => {
    frame ||= requestAnimationFrame(() => {
      frame = 0;
      if (canvas.isConnected) paint(palette);
    });
  };
  const sizes = new ResizeObserver(() => {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (width === 0 || height === 0) return;
    canvas.width = Math.round(width * density());
    canvas.height = Math.round(height * density());
    resized({ width, height });
    paint(palette);
  });
  sizes.observe(canvas);
  const theme = matchMedia("(prefers-color-scheme: dark)");
  const recolour = () => {
    palette = paletteOf();
    redraw();
  };
  theme.addEventListener("change", recolour);
  const leave = () => {
    sizes.disconnect();
    theme.removeEventListener("change", recolour);
    cancelAnimationFrame(frame);
  };
  return { redraw, leave };
}

/**
 * @param {{look: () => {view: View, size: Size}, turnTo: (view: View) => void, fit: () => void}} hands
 * @returns {HTMLElement}
 */
export function zoomButtons({ look, turnTo, fit }) {
  const zoom = (/** @type {number} */ factor) => () => {
    const { view, size } = look();
    turnTo(zoomAt(view, size, [size.width / 2, size.height / 2], factor));
  };
  return h("div", { class: "zoom", role: "group", "aria-label": t("Zoom") },
    h("button", { type: "button", "aria-label": t("Zoom in"), title: t("Zoom in (+)"), click: zoom(ZOOM) }, icon("plus")),
    h("button", { type: "button", "aria-label": t("Zoom out"), title: t("Zoom out (-)"), click: zoom(1 / ZOOM) }, icon("minus")),
    h("button", { type: "button", "aria-label": t("Show all"), title: t("Show all (0)"), click: () => fit() }, icon("fit")));
}

/** @returns {{bar: HTMLElement, show: (view: View) => void}} */
export function makeScale() {
  const bar = h("div", { class: "scale-bar", role: "img" }, h("span"));
  const show = (/** @type {View} */ { px_per_m }) => {
    const { length_m, length_px } = scaleBar(px_per_m, BAR_PX);
    bar.style.width = `${length_px}px`;
    bar.firstChild.textContent = formatMetres(length_m).replace(/[.,]0+ /, " ");
    bar.setAttribute("aria-label", t("Scale: this bar is {{length}} long", { length: bar.textContent }));
  };
  return { bar, show };
}

// The picture of a floor plan, and its negative for dark pages.

/** @param {string} address @returns {Promise<{image: HTMLImageElement, negative: HTMLCanvasElement,
 *   aspect: number, inverted: null}>} aspect: height by width; inverted: nobody said */
export async function loadPlanImage(address) {
  const image = new Image();
  image.src = address;
  await image.decode();
  return {
    image,
    negative: negativeOf(image),
    aspect: image.naturalHeight / image.naturalWidth,
    inverted: null,
  };
}

/** Whether the negative is shown: as somebody said, else where the page is dark now. @param {{inverted: boolean | null}} plan */
export function isNegative({ inverted }) {
  return inverted ?? matchMedia("(prefers-color-scheme: dark)").matches;
}

/** @param {HTMLImageElement} image */
function negativeOf(image) {
  const canvas = Object.assign(document.createElement("canvas"), { width: image.naturalWidth, height: image.naturalHeight });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.drawImage(image, 0, 0);
  context.globalCompositeOperation = "difference";
  context.fillStyle = "white";
  context.fillRect(0, 0, canvas.width, canvas.height);
  // A transparent image has become white where it was clear: give it its own outline back.
  context.globalCompositeOperation = "destination-in";
  context.drawImage(image, 0, 0);
  return canvas;
}

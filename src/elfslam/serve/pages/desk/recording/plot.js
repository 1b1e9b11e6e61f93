// One curve as a drawing that stretches with the page, with what is under the finger told above it.

import { h, svg } from "../../shared/dom.js";
import { formatDuration } from "../../shared/format.js";
import { extentOf, isCounted, pathOf, readingText, shareDown, stretchAt, summaryOf, tickText, ticksOf, timeAt, titleOf } from "./curves.js";

/** @typedef {import("./curves.js").Curve} Curve */
/** @typedef {import("./curves.js").Span} Span */

const BOX = { width: 800, height: 120 };
const TIMES = [0, 0.25, 0.5, 0.75, 1];

/** @param {Curve} curve @param {Span} span that all curves of a page share */
export function plotOf(curve, span) {
  const extent = extentOf(curve);
  if (extent === null) return null;
  const told = h("output", { class: "soft" }, `${curve.unit}`);
  const mark = h("i", { class: "plot-mark", hidden: true });
  const ticks = ticksOf(extent);
  const percent = (/** @type {number} */ value) => `${(shareDown(extent, value) * 100).toFixed(2)}%`;
  const lines = ticks.map((tick) => svg("line", { x1: 0, x2: BOX.width, y1: percent(tick), y2: percent(tick), class: "plot-grid" }));
  const drawing = svg("svg", { viewBox: `0 0 ${BOX.width} ${BOX.height}`, preserveAspectRatio: "none", role: "img", "aria-label": summaryOf(curve) },
    lines, svg("path", { d: pathOf(curve, extent, span, BOX), class: isCounted(curve) ? "plot-bars" : "plot-band" }));
  const labels = ticks.map((tick) => h("span", { style: { top: percent(tick) } }, tickText(tick)));
  const area = h("div", { class: "plot-area" }, drawing, mark);
  follow(area, mark, told, curve, span);
  return h("figure", { class: "plot" },
    h("figcaption", null, h("strong", null, titleOf(curve)), told),
    h("div", { class: "plot-scale", "aria-hidden": "true" }, labels), area,
    h("div", { class: "plot-times", "aria-hidden": "true" }, TIMES.map((share) => h("span", null, formatDuration(timeAt(span, share))))));
}

/** Tell what is under the finger or the mouse. @param {HTMLElement} area @param {HTMLElement} mark
 * @param {HTMLOutputElement} told @param {Curve} curve @param {Span} span */
function follow(area, mark, told, curve, span) {
  area.addEventListener("pointermove", (event) => {
    const { left, width } = area.getBoundingClientRect();
    const share = Math.min(1, Math.max(0, (event.clientX - left) / width));
    mark.hidden = false;
    mark.style.setProperty("left", `${share * 100}%`);
    const t_s = timeAt(span, share);
    told.textContent = `${formatDuration(t_s)}: ${readingText(curve, stretchAt(curve, t_s))}`;
  });
  area.addEventListener("pointerleave", () => {
    mark.hidden = true;
    told.textContent = curve.unit;
  });
}

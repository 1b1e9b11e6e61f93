// What every map on a canvas has: it is drawn anew when something has changed, its size or the page's
// colours among it; buttons that zoom; a bar that says how long a metre is.

import { h } from "../dom.js";
import { formatMetres } from "../format.js";
import { icon } from "../icons.js";
import { density } from "./ground.js";
import { scaleBar, zoomAt } from "./projection.js";
import { t } from "../words.js";

/** @typedef {import("./projection.js").View} View */
/** @typedef {import("./projection.js").Size} Size */

const BAR_PX = 140;
const ZOOM = 1.5;

/**
 * @param {HTMLCanvasElement} canvas
 * @param {{paint: () => void, resized: (size: Size) => void, recoloured: () => void}} told
 * @returns {{redraw: () => void, leave: () => void}} redraw: before the next frame is shown
 */
export function mountSurface(canvas, { paint, resized, recoloured }) {
  let frame = 0;
  const redraw = () => {
    frame ||= requestAnimationFrame(() => {
      frame = 0;
      if (canvas.isConnected) paint();
    });
  };
  const sizes = new ResizeObserver(() => {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (width === 0 || height === 0) return;
    canvas.width = Math.round(width * density());
    canvas.height = Math.round(height * density());
    resized({ width, height });
    paint();
  });
  sizes.observe(canvas);
  const theme = matchMedia("(prefers-color-scheme: dark)");
  const recolour = () => {
    recoloured();
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

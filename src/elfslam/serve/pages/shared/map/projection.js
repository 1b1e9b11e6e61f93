// Between the map (metres, y up) and the canvas (pixels, y down). Pure.

/** @typedef {[number, number]} Point */
/** @typedef {{width: number, height: number}} Size of the canvas, in pixels */
/** @typedef {{x_m: number, y_m: number, px_per_m: number}} View the map point at the canvas's middle */
/** @typedef {[number, number, number, number]} Bounds x0, y0, x1, y1 in metres */

const CLOSEST_PX_PER_M = 4000;
const FARTHEST_PX_PER_M = 0.02;

/** @param {View} view @param {Size} size @param {Point} xy_m @returns {Point} pixels */
export function toScreen(view, size, [x_m, y_m]) {
  return [
    size.width / 2 + (x_m - view.x_m) * view.px_per_m,
    size.height / 2 - (y_m - view.y_m) * view.px_per_m,
  ];
}

/** @param {View} view @param {Size} size @param {Point} xy_px @returns {Point} metres */
export function toMap(view, size, [x_px, y_px]) {
  return [
    view.x_m + (x_px - size.width / 2) / view.px_per_m,
    view.y_m - (y_px - size.height / 2) / view.px_per_m,
  ];
}

/** The view that shows all of `bounds` with a margin. @param {Bounds} bounds @param {Size} size
 * @param {number} [margin_px] @returns {View} */
export function fit([x0, y0, x1, y1], size, margin_px = 48) {
  const width_m = Math.max(x1 - x0, 0.5);
  const height_m = Math.max(y1 - y0, 0.5);
  const px_per_m = Math.min(
    Math.max(size.width - 2 * margin_px, 40) / width_m,
    Math.max(size.height - 2 * margin_px, 40) / height_m,
  );
  return { x_m: (x0 + x1) / 2, y_m: (y0 + y1) / 2, px_per_m: within(px_per_m) };
}

/** Nearer or farther, the map under `at_px` staying there. @param {View} view @param {Size} size
 * @param {Point} at_px @param {number} factor @returns {View} */
export function zoomAt(view, size, at_px, factor) {
  const px_per_m = within(view.px_per_m * factor);
  return holding(toMap(view, size, at_px), at_px, px_per_m, size);
}

/** @param {View} view @param {Point} by_px @returns {View} */
export function pan(view, [dx_px, dy_px]) {
  return { ...view, x_m: view.x_m - dx_px / view.px_per_m, y_m: view.y_m + dy_px / view.px_per_m };
}

/**
 * Two fingers: the map under each stays under it, but for turning.
 * @param {View} view @param {Size} size @param {[Point, Point]} before_px @param {[Point, Point]} after_px
 * @returns {View}
 */
export function pinch(view, size, before_px, after_px) {
  const spread = (/** @type {[Point, Point]} */ [a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  const middle = (/** @type {[Point, Point]} */ [a, b]) =>
    /** @type {Point} */ ([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]);
  const factor = spread(after_px) / Math.max(spread(before_px), 1);
  const held_m = toMap(view, size, middle(before_px));
  return holding(held_m, middle(after_px), within(view.px_per_m * factor), size);
}

/** @param {Point} xy_m @param {Point} at_px @param {number} px_per_m @param {Size} size
 * @returns {View} */
function holding([x_m, y_m], [x_px, y_px], px_per_m, size) {
  return {
    x_m: x_m - (x_px - size.width / 2) / px_per_m,
    y_m: y_m + (y_px - size.height / 2) / px_per_m,
    px_per_m,
  };
}

/** @param {number} px_per_m */
function within(px_per_m) {
  return Math.min(CLOSEST_PX_PER_M, Math.max(FARTHEST_PX_PER_M, px_per_m));
}

/** The longest round length (1, 2 or 5 times a power of ten) that fits.
 * @param {number} px_per_m @param {number} most_px @returns {{length_m: number, length_px: number}} */
export function scaleBar(px_per_m, most_px) {
  const most_m = most_px / px_per_m;
  const power = 10 ** Math.floor(Math.log10(most_m));
  const times = [5, 2, 1].find((n) => n * power <= most_m * (1 + 1e-9)) ?? 1;
  return { length_m: times * power, length_px: times * power * px_per_m };
}

/** The smallest bounds around both; either may be null. @param {Bounds | null} one
 * @param {Bounds | null} other @returns {Bounds | null} */
export function around(one, other) {
  if (!one || !other) return one ?? other;
  return [Math.min(one[0], other[0]), Math.min(one[1], other[1]),
    Math.max(one[2], other[2]), Math.max(one[3], other[3])];
}

/** @param {Iterable<Point>} points @returns {Bounds | null} */
export function boundsOf(points) {
  /** @type {Bounds | null} */
  let bounds = null;
  for (const [x, y] of points) bounds = around(bounds, [x, y, x, y]);
  return bounds;
}

// Where a floor plan lies under the map. Pure.

/** @typedef {import("./projection.js").Point} Point */
/** @typedef {{width_m: number, x_m: number, y_m: number, heading_rad: number, opacity: number}} Placement
 * x_m, y_m: the image's lower left corner in the map; heading_rad: of its lower edge */

export const NARROWEST_M = 0.1;
export const WIDEST_M = 5000;

/** Where a point of the plan lies. @param {Placement} placement @param {Point} uv_m metres along the
 * lower edge and up from it @returns {Point} */
export function planToMap({ x_m, y_m, heading_rad }, [u_m, v_m]) {
  const [cos, sin] = [Math.cos(heading_rad), Math.sin(heading_rad)];
  return [x_m + u_m * cos - v_m * sin, y_m + u_m * sin + v_m * cos];
}

/** @param {Placement} placement @param {Point} xy_m @returns {Point} */
export function mapToPlan({ x_m, y_m, heading_rad }, [px_m, py_m]) {
  const [cos, sin] = [Math.cos(heading_rad), Math.sin(heading_rad)];
  return [(px_m - x_m) * cos + (py_m - y_m) * sin, (py_m - y_m) * cos - (px_m - x_m) * sin];
}

/** Lower left, lower right, upper right, upper left. @param {Placement} placement
 * @param {number} aspect height by width @returns {Point[]} */
export function corners(placement, aspect) {
  const [w, h] = [placement.width_m, placement.width_m * aspect];
  const places = /** @type {Point[]} */ ([[0, 0], [w, 0], [w, h], [0, h]]);
  return places.map((uv) => planToMap(placement, uv));
}

/** @param {Placement} placement @param {number} aspect @returns {Point} */
export function middle(placement, aspect) {
  return planToMap(placement, [placement.width_m / 2, (placement.width_m * aspect) / 2]);
}

/** @param {Placement} placement @param {number} aspect @param {Point} xy_m */
export function isOnPlan(placement, aspect, xy_m) {
  const [u, v] = mapToPlan(placement, xy_m);
  return u >= 0 && v >= 0 && u <= placement.width_m && v <= placement.width_m * aspect;
}

/** A first guess: centred, a little larger than the walks. @param {import("./projection.js").Bounds} bounds
 * @param {number} aspect @param {number | null} [known_m] its width, where that is known @returns {Placement} */
export function firstPlacement([x0, y0, x1, y1], aspect, known_m = null) {
  const width_m = known_m ?? 1.15 * Math.max(x1 - x0, (y1 - y0) / aspect, 1);
  const [x_m, y_m] = [(x0 + x1 - width_m) / 2, (y0 + y1 - width_m * aspect) / 2];
  return rounded({ width_m, x_m, y_m, heading_rad: 0, opacity: 0.6 });
}

/** @param {Placement} placement @param {Point} by_m @returns {Placement} */
export function moved(placement, [dx_m, dy_m]) {
  return { ...placement, x_m: placement.x_m + dx_m, y_m: placement.y_m + dy_m };
}

/** Turned to a heading about the middle of the image. @param {Placement} placement
 * @param {number} aspect @param {number} heading_rad @returns {Placement} */
export function turned(placement, aspect, heading_rad) {
  const [cx, cy] = middle(placement, aspect);
  const turn = { ...placement, heading_rad: wrapped(heading_rad) };
  const [nx, ny] = middle(turn, aspect);
  return moved(turn, [cx - nx, cy - ny]);
}

/** A corner drawn to a point, the opposite corner staying. @param {Placement} placement
 * @param {number} aspect @param {number} corner 0 to 3, as `corners` @param {Point} to_m
 * @returns {Placement} */
export function stretched(placement, aspect, corner, to_m) {
  const fixed_m = corners(placement, aspect)[(corner + 2) % 4];
  const [du, dv] = diagonal(placement, aspect, corner, fixed_m, to_m);
  const width_m = clamp((du + dv * aspect) / (1 + aspect * aspect));
  const stretch = { ...placement, width_m };
  const now_m = corners(stretch, aspect)[(corner + 2) % 4];
  return moved(stretch, [fixed_m[0] - now_m[0], fixed_m[1] - now_m[1]]);
}

/** How far apart the fixed corner and the hand are, along both edges, outwards.
 * @param {Placement} placement @param {number} aspect @param {number} corner @param {Point} fixed_m
 * @param {Point} to_m @returns {Point} */
function diagonal(placement, aspect, corner, fixed_m, to_m) {
  const [fu, fv] = mapToPlan(placement, fixed_m);
  const [tu, tv] = mapToPlan(placement, to_m);
  const right = corner === 1 || corner === 2;
  return [right ? tu - fu : fu - tu, corner >= 2 ? tv - fv : fv - tv];
}

/** Another width, the middle of the image staying. @param {Placement} placement @param {number} aspect
 * @param {number} width_m @returns {Placement} */
export function widened(placement, aspect, width_m) {
  const [cx, cy] = middle(placement, aspect);
  const wide = { ...placement, width_m: clamp(width_m) };
  const [nx, ny] = middle(wide, aspect);
  return moved(wide, [cx - nx, cy - ny]);
}

/** To millimetres, ten-thousandths of a radian and percent: what is saved and shown.
 * @param {Placement} placement @returns {Placement} */
export function rounded(placement) {
  const to = (/** @type {number} */ value, /** @type {number} */ digits) => Number(value.toFixed(digits));
  return {
    width_m: to(placement.width_m, 3),
    x_m: to(placement.x_m, 3),
    y_m: to(placement.y_m, 3),
    heading_rad: to(wrapped(placement.heading_rad), 4),
    opacity: to(Math.min(1, Math.max(0, placement.opacity)), 2),
  };
}

/** The matrix (a, b, c, d, e, f) that draws an image of 1 by 1 pixels, y down, onto the canvas.
 * @param {Placement} placement @param {number} aspect @param {(xy_m: Point) => Point} toScreen
 * @returns {[number, number, number, number, number, number]} */
export function imageMatrix(placement, aspect, toScreen) {
  const [lowerLeft, , upperRight, upperLeft] = corners(placement, aspect).map(toScreen);
  return [upperRight[0] - upperLeft[0], upperRight[1] - upperLeft[1],
    lowerLeft[0] - upperLeft[0], lowerLeft[1] - upperLeft[1], upperLeft[0], upperLeft[1]];
}

/** @param {number} angle_rad @returns {number} in [-pi, pi) */
export function wrapped(angle_rad) {
  const turn = 2 * Math.PI;
  return ((((angle_rad + Math.PI) % turn) + turn) % turn) - Math.PI;
}

/** @param {number} width_m */
function clamp(width_m) {
  return Math.min(WIDEST_M, Math.max(NARROWEST_M, width_m));
}

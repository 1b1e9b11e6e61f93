/** How sure a fix is, as an ellipse and as a radius. Pure. */

/** @typedef {[number, number, number]} Covariance xx, xy, yy in square metres */

/** Of the places where the walker may be, so many lie within: two of three. */
const SHARE = 2 / 3;
/** Sigmas that hold this share of a bell curve in the plane. */
export const SIGMAS = Math.sqrt(-2 * Math.log(1 - SHARE));

/**
 * @param {Covariance} covariance
 * @returns {{majorM: number, minorM: number, turnRad: number}} half axes of the ellipse that holds SHARE;
 *   turnRad: of the long one, counter-clockwise from x
 */
export function ellipseOf([xx, xy, yy]) {
  const middle = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  return {
    majorM: SIGMAS * Math.sqrt(Math.max(middle + spread, 0)),
    minorM: SIGMAS * Math.sqrt(Math.max(middle - spread, 0)),
    turnRad: 0.5 * Math.atan2(2 * xy, xx - yy),
  };
}

/** The circle that stands for it in words. @param {Covariance} covariance @returns {number} metres */
export function radiusOf([xx, , yy]) {
  return SIGMAS * Math.sqrt(Math.max((xx + yy) / 2, 0));
}

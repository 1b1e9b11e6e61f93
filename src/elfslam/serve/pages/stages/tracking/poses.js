/** Planar poses x m, y m, heading rad, as rows (3p): elfslam.base.geometry. */

import { wrapAngle } from "../motion/series.js";

/**
 * Writes row k of a_from_c: the pose a_from_b of that row and what follows it.
 * @param {Float64Array} out (3p) @param {number} k
 * @param {number} x @param {number} y @param {number} headingRad a_from_b
 * @param {number} forward @param {number} left @param {number} turnRad b_from_c
 */
export function composeInto(out, k, x, y, headingRad, forward, left, turnRad) {
  const [cos, sin] = [Math.cos(headingRad), Math.sin(headingRad)];
  out[3 * k] = x + cos * forward - sin * left;
  out[3 * k + 1] = y + sin * forward + cos * left;
  out[3 * k + 2] = wrapAngle(headingRad + turnRad);
}

/** Poses in the middle of a step. @param {Float64Array} before (3p) @param {Float64Array} after (3p) */
export function halfwayBetween(before, after) {
  const middle = new Float64Array(before.length);
  for (let k = 0; k < before.length; k += 3) {
    middle[k] = (before[k] + after[k]) / 2;
    middle[k + 1] = (before[k + 1] + after[k + 1]) / 2;
    middle[k + 2] = before[k + 2] + wrapAngle(after[k + 2] - before[k + 2]) / 2;
  }
  return middle;
}

/** All poses moved alike. @param {Float64Array} poses (3p) @param {number[]} move (3) @returns {Float64Array} */
export function movedBy(poses, move) {
  const out = new Float64Array(poses.length);
  const [forward, left, turn] = move;
  for (let k = 0; 3 * k < poses.length; k += 1) {
    composeInto(out, k, poses[3 * k], poses[3 * k + 1], poses[3 * k + 2], forward, left, turn);
  }
  return out;
}

/** Where the walker heads: the rate of turn about the vertical, summed: elfslam.line.motion.heading. */

import { averaged } from "./level.js";
import { interpolate, roundHalfEven } from "./series.js";

/** Before the first footfall a foot is lifted; before that, a phone may be at rest. */
const SETTING_OFF_S = 0.6;
const REST_S = 0.5;

/** @typedef {import("./types.js").Level} Level */

/**
 * @param {Level} levelled @param {{heading_window_s: number}} parameters
 * @returns {Float64Array} heading, rad, averaged over a stride
 */
export function smoothHeading(levelled, parameters) {
  return averaged(phoneTurn(levelled), parameters.heading_window_s, levelled.rateHz);
}

/** @param {Level} levelled @returns {Float64Array} how far, rad, the phone has turned since the first row */
export function phoneTurn({ gyro, up, rateHz }) {
  const yaw = (/** @type {number} */ k) => gyro[0][k] * up[0][k] + gyro[1][k] * up[1][k] + gyro[2][k] * up[2][k];
  const turned = new Float64Array(gyro[0].length);
  for (let k = 1; k < turned.length; k += 1) {
    turned[k] = turned[k - 1] + (yaw(k) + yaw(k - 1)) / 2 / rateHz;
  }
  return turned;
}

/**
 * How far (rad) the walker has turned by the first footstep since the recording began; null where the
 * phone was not at rest for the first half second.
 * @param {Level} levelled @param {Float64Array} bounce @param {number} footstepS
 * @param {{heading_window_s: number, least_bounce_mps2: number}} parameters
 * @returns {number | null}
 */
export function turnedSinceRest(levelled, bounce, footstepS, parameters) {
  const { tS, rateHz } = levelled;
  const rest = roundHalfEven(REST_S * rateHz);
  if (tS.filter((s) => s < footstepS - SETTING_OFF_S).length < rest) return null;
  const moving = (/** @type {number} */ value) => Math.abs(value) > parameters.least_bounce_mps2;
  if (bounce.subarray(0, rest).some(moving)) return null;
  const begun = phoneTurn(levelled).subarray(0, rest);
  const facingRad = begun.reduce((sum, value) => sum + value, 0) / begun.length;
  return interpolate(footstepS, tS, smoothHeading(levelled, parameters)) - facingRad;
}

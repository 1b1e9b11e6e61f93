/** Where the walker heads: the rate of turn about the vertical, summed: elfslam.stages.motion.reckoning. */

import { averaged } from "./level.js";

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

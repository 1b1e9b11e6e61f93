/** Footsteps: peaks of the vertical acceleration in the band of walking: elfslam.stages.motion.reckoning. */

import { bandPass, usualPadding, zeroPhase } from "./filters.js";
import { GRAVITY_MPS2, averaged } from "./level.js";
import { findPeaks } from "./peaks.js";
import { roundHalfEven } from "./series.js";

/**
 * @typedef {import("./types.js").Level} Level
 * @typedef {import("./types.js").MotionParameters} MotionParameters
 */

/**
 * @param {Level} levelled @param {Float64Array} bounce @param {MotionParameters} parameters
 * @returns {Float64Array} times of the footfalls
 */
export function footfalls({ tS, rateHz }, bounce, parameters) {
  const rms = bounceRms(bounce, parameters.bounce_window_s, rateHz);
  const distance = Math.max(1, roundHalfEven(parameters.least_interval_s * rateHz));
  const { peaks, prominences } = findPeaks(bounce, distance, parameters.least_bounce_mps2);
  const wanted = (/** @type {number} */ peak) => Math.max(
    parameters.least_bounce_mps2, parameters.relative_bounce * 2 * Math.SQRT2 * rms[peak],
  );
  const kept = peaks.filter((peak, k) => prominences[k] >= wanted(peak));
  return Float64Array.from(kept, (peak) => tS[peak] + peakOffset(bounce, peak) / rateHz);
}

/**
 * @param {Level} levelled @param {MotionParameters} parameters
 * @returns {Float64Array} the vertical acceleration in the footstep band, m/s2
 */
export function verticalBounce({ accel, up, rateHz }, parameters) {
  const vertical = accel[0].map((_, k) => (
    accel[0][k] * up[0][k] + accel[1][k] * up[1][k] + accel[2][k] * up[2][k] - GRAVITY_MPS2
  ));
  const band = bandPass(parameters.cadence_low_hz, parameters.cadence_high_hz, rateHz);
  return zeroPhase(band, vertical, usualPadding(band), "odd");
}

/**
 * @param {Float64Array} bounce @param {number} windowS @param {number} rateHz
 * @returns {Float64Array} its root mean square over a window of time
 */
export function bounceRms(bounce, windowS, rateHz) {
  const power = averaged(bounce.map((value) => value * value), windowS, rateHz);
  return power.map((value) => Math.sqrt(Math.max(value, 0)));
}

/**
 * Where the parabola through a peak and its neighbours is highest, in samples from it.
 * @param {Float64Array} values @param {number} peak
 */
function peakOffset(values, peak) {
  const [before, at, after] = [values[peak - 1], values[peak], values[peak + 1]];
  return (before - after) / Math.min(2 * (before - 2 * at + after), -1e-12);
}

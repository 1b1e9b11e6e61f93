/** How long each step is, from how far and how often the walker bounces: elfslam.stages.motion.reckoning. */

import { runningMedian } from "./filters.js";
import { bounceRms } from "./footsteps.js";
import { differences, halfways, interpolateAll } from "./series.js";

/** @typedef {import("./types.js").MotionParameters} MotionParameters */

/** The usual interval is the median of so many. */
export const STEPS_AROUND = 5;

/**
 * @param {import("./types.js").Level} levelled @param {Float64Array} bounce
 * @param {Float64Array} footstepsS times (n) @param {MotionParameters} parameters
 * @returns {Float64Array} lengths (n-1), m, of the steps between the footsteps
 */
export function lengthsBetween({ tS, rateHz }, bounce, footstepsS, parameters) {
  const rms = bounceRms(bounce, parameters.length_window_s, rateHz);
  const around = interpolateAll(halfways(footstepsS), tS, rms);
  const intervalsS = differences(footstepsS);
  const usualS = runningMedian(intervalsS, STEPS_AROUND);
  return intervalsS.map((intervalS, k) => {
    const isPause = intervalS > parameters.pause_intervals * usualS[k];
    const lengthM = isPause ? parameters.pause_length_m : walkedM(around[k], 1 / usualS[k], parameters);
    return parameters.step_scale * lengthM;
  });
}

/**
 * A power law in bounce and cadence; a cadence out of the band is that of someone who stops and goes.
 * @param {number} bounceMps2 @param {number} cadenceHz @param {MotionParameters} parameters
 */
function walkedM(bounceMps2, cadenceHz, parameters) {
  const inBandHz = clipped(cadenceHz, parameters.cadence_low_hz, parameters.cadence_high_hz);
  const lengthM = parameters.step_length_m
    * (bounceMps2 / parameters.typical_bounce_mps2) ** parameters.length_power_of_bounce
    * (inBandHz / parameters.typical_cadence_hz) ** parameters.length_power_of_cadence;
  return clipped(lengthM, parameters.shortest_step_m, parameters.longest_step_m);
}

/** @param {number} value @param {number} low @param {number} high */
function clipped(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

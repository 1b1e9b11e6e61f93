/** Footsteps: peaks of the vertical acceleration in the band of walking: elfslam.stages.motion.reckoning. */

import { bandPass, roundHalfEven, usualPadding, zeroPhase } from "./filters.js";
import { GRAVITY_MPS2, averaged } from "./level.js";

/**
 * @typedef {import("./filters.js").Level} Level
 * @typedef {import("./filters.js").MotionParameters} MotionParameters
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

// Peaks of a signal, by height over what surrounds them and by distance, as scipy.signal.find_peaks.

/**
 * @param {Float64Array} values
 * @param {number} distance least number of samples between peaks, the higher ones first
 * @param {number} least prominence
 * @returns {{peaks: number[], prominences: number[]}} in order of time
 */
export function findPeaks(values, distance, least) {
  const apart = farApart(localMaxima(values), values, Math.ceil(distance));
  const found = apart.map((peak) => ({ peak, prominence: prominenceOf(values, peak) }));
  const kept = found.filter(({ prominence }) => prominence >= least);
  return { peaks: kept.map(({ peak }) => peak), prominences: kept.map(({ prominence }) => prominence) };
}

/** The middle of each stretch of equal values that is higher than what lies beside it. @param {Float64Array} values */
function localMaxima(values) {
  const maxima = [];
  const last = values.length - 1;
  for (let k = 1; k < last; k += 1) {
    if (values[k - 1] >= values[k]) continue;
    let end = k + 1;
    while (end < last && values[end] === values[k]) end += 1;
    if (values[end] < values[k]) {
      maxima.push((k + end - 1) >> 1);
      k = end;
    }
  }
  return maxima;
}

/** @param {number[]} peaks @param {Float64Array} values @param {number} distance */
function farApart(peaks, values, distance) {
  const isKept = new Array(peaks.length).fill(true);
  const byHeight = peaks.map((_, k) => k).sort((a, b) => values[peaks[b]] - values[peaks[a]]);
  for (const k of byHeight) {
    if (!isKept[k]) continue;
    for (let j = k - 1; j >= 0 && peaks[k] - peaks[j] < distance; j -= 1) isKept[j] = false;
    for (let j = k + 1; j < peaks.length && peaks[j] - peaks[k] < distance; j += 1) isKept[j] = false;
  }
  return peaks.filter((_, k) => isKept[k]);
}

/**
 * How far one must come down, on the higher side, before it goes higher than the peak.
 * @param {Float64Array} values @param {number} peak
 */
function prominenceOf(values, peak) {
  const lowest = (/** @type {number} */ step) => {
    let low = values[peak];
    for (let k = peak; k >= 0 && k < values.length && values[k] <= values[peak]; k += step) {
      if (values[k] < low) low = values[k];
    }
    return low;
  };
  return values[peak] - Math.max(lowest(-1), lowest(1));
}

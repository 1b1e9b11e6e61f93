/**
 * Footsteps while the walk goes on: the line's own stages over a window that slides along, as in
 * elfslam.stages.motion.live. A footstep is final, and given out once, as soon as the walk has gone on for
 * `live_delay_s` beyond it.
 */

import { MOTION } from "../constants.js";
import {
  bandPass, differences, halfways, interpolate, interpolateAll, roundHalfEven, runningMedian, usualPadding, zeroPhase,
  averaged, evenlySampled, GRAVITY_MPS2, level, NO_REST, rateOf, restUntil, stillRows,
} from "./filters.js";

/**
 * @typedef {import("./filters.js").Imu} Imu
 * @typedef {import("./filters.js").Level} Level
 * @typedef {import("./filters.js").Rest} Rest
 * @typedef {import("./filters.js").Step} Step
 * @typedef {import("./filters.js").MotionParameters} MotionParameters
 * @typedef {{tS: number[], accelMps2: number[], gyroRadps: number[]}} Rows an Imu that grows
 * @typedef {{footstepsS: number[], headingRad: number, turnedRad: number, rest: Rest}} Past
 *   the last footsteps given out, where the walker headed at the last of them, how far the phone had turned
 *   as the window begins, and its gyroscope at rest before that
 */

/** A rest leaves the window as a whole: until it ends, so many times `still_s` of it stay. The usual interval of steps is
 * the median of so many. */
const { REST_KEPT, STEPS_AROUND } = MOTION;

/** @param {Rest} rest @returns {Past} */
function beginning(rest = NO_REST) {
  return { footstepsS: [], headingRad: 0, turnedRad: 0, rest };
}

/**
 * Footsteps of readings as they come. `push` takes a reading (s, m/s2 with gravity, rad/s, phone axes), one
 * that is not later than the last is left out; `take` gives the steps that became final, once each. After a
 * gap of more than `longest_gap_s` the walk begins anew. Readings slower than `least_rate_hz` give no steps.
 * @param {MotionParameters} parameters
 * @returns {{push: (tS: number, accelMps2: Iterable<number>, gyroRadps: Iterable<number>) => void,
 *   take: (nowS?: number) => Step[]}} readings after `nowS` are not looked at
 */
export function makeFootsteps(parameters) {
  /** @type {Rows} */
  let rows = { tS: [], accelMps2: [], gyroRadps: [] };
  let past = beginning();

  /** @param {number} tS @param {Iterable<number>} accelMps2 @param {Iterable<number>} gyroRadps */
  const push = (tS, accelMps2, gyroRadps) => {
    const lastS = rows.tS[rows.tS.length - 1] ?? -Infinity;
    if (!(tS > lastS)) return;
    if (rows.tS.length && tS - lastS > parameters.longest_gap_s) {
      past = beginning(restedIn(rows, past, parameters));
      rows = { tS: [], accelMps2: [], gyroRadps: [] };
    }
    rows.tS.push(tS);
    rows.accelMps2.push(...accelMps2);
    rows.gyroRadps.push(...gyroRadps);
  };
  const take = (nowS = Infinity) => {
    const window = readUntil(rows, nowS);
    if (!isEnough(window.tS, parameters)) return [];
    const levelled = level(window, parameters, past.rest);
    const { steps, footstepsS, headingRad } = wentOn(levelled, past, parameters);
    const { from, turnedRad, rest } = slid(window.tS, levelled, past, parameters);
    rows = rowsFrom(rows, from);
    past = { footstepsS, headingRad, turnedRad, rest };
    return steps;
  };
  return { push, take };
}

/** @param {Rows} rows @param {number} nowS @returns {Rows} */
function readUntil(rows, nowS) {
  let count = rows.tS.length;
  while (count > 0 && rows.tS[count - 1] > nowS) count -= 1;
  if (count === rows.tS.length) return rows;
  const { tS, accelMps2, gyroRadps } = rows;
  return { tS: tS.slice(0, count), accelMps2: accelMps2.slice(0, 3 * count), gyroRadps: gyroRadps.slice(0, 3 * count) };
}

/** @param {Rows} rows @param {number} from @returns {Rows} */
function rowsFrom(rows, from) {
  if (from === 0) return rows;
  const { tS, accelMps2, gyroRadps } = rows;
  return { tS: tS.slice(from), accelMps2: accelMps2.slice(3 * from), gyroRadps: gyroRadps.slice(3 * from) };
}

/** @param {number[]} tS @param {MotionParameters} parameters */
function isEnough(tS, parameters) {
  return tS.length > 1
    && tS[tS.length - 1] - tS[0] >= parameters.least_duration_s
    && rateOf(tS) >= parameters.least_rate_hz;
}

/**
 * The gyroscope at rest before these readings and in them.
 * @param {Rows} window @param {Past} past @param {MotionParameters} parameters @returns {Rest}
 */
function restedIn(window, past, parameters) {
  if (!isEnough(window.tS, parameters)) return past.rest;
  const { accel, gyro, tS } = evenlySampled(window);
  const isStill = stillRows(accel, gyro, rateOf(tS), parameters);
  return restUntil(gyro, isStill, isStill.length, past.rest);
}

/**
 * Footsteps found after the last one given out: what lies closer to it is that one again.
 * @param {ArrayLike<number>} foundS @param {number[]} givenS @param {{least_interval_s: number}} parameters
 * @returns {number[]}
 */
export function notGiven(foundS, givenS, parameters) {
  if (givenS.length === 0) return Array.from(foundS);
  const afterS = givenS[givenS.length - 1] + parameters.least_interval_s / 2;
  return Array.from(foundS).filter((tS) => tS > afterS);
}

/**
 * The steps that became final, the footsteps to remember and the heading at the last.
 * @param {Level} levelled @param {Past} past @param {MotionParameters} parameters
 * @returns {{steps: Step[], footstepsS: number[], headingRad: number}}
 */
function wentOn(levelled, past, parameters) {
  const { tS } = levelled;
  const known = past.footstepsS.length;
  const bounce = verticalBounce(levelled, parameters);
  const newerS = notGiven(footfalls(levelled, bounce, parameters), past.footstepsS, parameters);
  const finalS = tS[tS.length - 1] - parameters.live_delay_s;
  const count = known + newerS.filter((footstepS) => footstepS <= finalS).length;
  const footstepsS = [...past.footstepsS, ...newerS];
  const headings = headingsOf(levelled, footstepsS, past, parameters);
  const lengthsM = lengthsBetween(levelled, bounce, Float64Array.from(footstepsS), parameters);
  const steps = [];
  for (let k = Math.max(known - 1, 0); k < count - 1; k += 1) {
    steps.push(stepAt(k, footstepsS, lengthsM, headings, parameters));
  }
  return {
    steps,
    footstepsS: footstepsS.slice(0, count).slice(-STEPS_AROUND),
    headingRad: count ? headings.at[count - 1] : 0,
  };
}

/**
 * Headings at the footsteps, and at any time; those that were given out and left the window keep theirs.
 * @param {Level} levelled @param {number[]} footstepsS @param {Past} past @param {MotionParameters} parameters
 */
function headingsOf(levelled, footstepsS, past, parameters) {
  const { tS } = levelled;
  const smooth = smoothHeading(levelled, parameters);
  const when = (/** @type {number} */ atS) => past.turnedRad + interpolate(atS, tS, smooth);
  const leftS = tS[0] + parameters.heading_window_s / 2;
  const at = footstepsS.map((footstepS, k) => (
    k < past.footstepsS.length && footstepS < leftS ? past.headingRad : when(footstepS)
  ));
  return { at, when };
}

/**
 * @param {number} k @param {number[]} footstepsS @param {Float64Array} lengthsM
 * @param {ReturnType<typeof headingsOf>} headings @param {MotionParameters} parameters
 * @returns {Step} between footsteps k and k + 1; the first of a walk may point aside
 */
function stepAt(k, footstepsS, lengthsM, { at, when }, parameters) {
  const [fromS, tS] = [footstepsS[k], footstepsS[k + 1]];
  const sigmaRad = k ? parameters.heading_sigma_rad : settingOffSigmaRad(parameters);
  return {
    tS,
    fromS,
    moveM: moveOf(lengthsM[k], when((fromS + tS) / 2) - at[k], at[k + 1] - at[k]),
    sigma: sigmaOf(lengthsM[k], sigmaRad, parameters),
  };
}

/**
 * How many readings are older than the window, and what is remembered of them.
 * @param {number[]} tS of the readings @param {Level} levelled @param {Past} past @param {MotionParameters} parameters
 * @returns {{from: number, turnedRad: number, rest: Rest}}
 */
function slid(tS, levelled, past, parameters) {
  const { tS: evenS, rateHz, isStill, biased } = levelled;
  const beginS = evenS[evenS.length - 1] - parameters.live_window_s;
  const least = Math.trunc(REST_KEPT * parameters.still_s * rateHz);
  const cut = restKept(isStill, evenS.findIndex((each) => each >= beginS), least);
  const from = tS.findIndex((each) => each >= evenS[cut]);
  if (from === 0) return { from, turnedRad: past.turnedRad, rest: past.rest };
  return {
    from,
    turnedRad: past.turnedRad + interpolate(tS[from], evenS, phoneTurn(levelled)),
    rest: restUntil(biased, isStill, evenS.findIndex((each) => each >= tS[from]), past.rest),
  };
}

/**
 * The row to cut at instead of `cut`: a rest is not cut to pieces. Until it ends, `least` rows of it stay.
 * @param {boolean[]} isStill @param {number} cut @param {number} least @returns {number}
 */
export function restKept(isStill, cut, least) {
  if (cut === 0 || !isStill[cut]) return cut;
  const awake = isStill.indexOf(false, cut);
  const end = awake < 0 ? isStill.length : awake;
  return Math.max(0, Math.min(cut, end - least));
}

// Dead reckoning: steps and heading put together, a move per footstep: elfslam.stages.motion.reckoning.

/**
 * A move to the next footstep goes where the walker heads halfway through it.
 * @param {number} lengthM @param {number} asideRad @param {number} turnRad
 * @returns {number[]} forward m, left m, turn rad
 */
function moveOf(lengthM, asideRad, turnRad) {
  return [lengthM * Math.cos(asideRad), lengthM * Math.sin(asideRad), turnRad];
}

/**
 * The sigma of a move.
 * @param {number} lengthM @param {number} headingRad the sigma of its turn @param {MotionParameters} parameters
 * @returns {number[]}
 */
function sigmaOf(lengthM, headingRad, parameters) {
  return [parameters.forward_sigma * lengthM, parameters.lateral_sigma * lengthM, headingRad];
}

/** Of the first step, which may point aside, too. @param {MotionParameters} parameters */
function settingOffSigmaRad(parameters) {
  return Math.hypot(parameters.heading_sigma_rad, parameters.setting_off_sigma_rad);
}

// Where the walker heads: the rate of turn about the vertical, summed: elfslam.stages.motion.heading.

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

// How long each step is, from how far and how often the walker bounces: elfslam.stages.motion.lengths.

/**
 * @param {import("./filters.js").Level} levelled @param {Float64Array} bounce
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
  const byBounceM = parameters.step_length_m
    * (bounceMps2 / parameters.typical_bounce_mps2) ** parameters.length_power_of_bounce
    * (inBandHz / parameters.typical_cadence_hz) ** parameters.length_power_of_cadence;
  const lengthM = withWalkRatio(byBounceM, inBandHz, parameters);
  return clipped(lengthM, parameters.shortest_step_m, parameters.longest_step_m);
}

/**
 * The law of the bounce and the walk ratio, weighted by their precisions: the slower, the less the law knows.
 * @param {number} byBounceM @param {number} cadenceHz @param {MotionParameters} parameters
 */
function withWalkRatio(byBounceM, cadenceHz, parameters) {
  const slower = Math.log(Math.max(parameters.typical_cadence_hz / cadenceHz, 1));
  const variance = parameters.bounce_law_sigma ** 2 + (parameters.bounce_law_sigma_if_slow * slower) ** 2;
  const weight = 1 / (1 + variance / parameters.walk_ratio_sigma ** 2);
  return byBounceM ** weight * (parameters.walk_ratio_m_per_hz * cadenceHz) ** (1 - weight);
}

/** @param {number} value @param {number} low @param {number} high */
function clipped(value, low, high) {
  return Math.min(Math.max(value, low), high);
}

// Footsteps: peaks of the vertical acceleration in the band of walking: elfslam.stages.motion.reckoning.

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

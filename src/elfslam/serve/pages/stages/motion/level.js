/** The inertial sensors on an even clock, with the direction that points up: elfslam.stages.motion.level. */

import {
  columnsOf, differences, interpolateAll, lowPass, median, roundHalfEven, runningMean, zeroPhase,
} from "./filters.js";

/**
 * @typedef {import("./filters.js").Imu} Imu
 * @typedef {import("./filters.js").Axes} Axes
 * @typedef {import("./filters.js").Level} Level
 * @typedef {import("./filters.js").Rest} Rest
 * @typedef {import("./filters.js").MotionParameters} MotionParameters
 */

export const GRAVITY_MPS2 = 9.81;

/** @type {Rest} */
export const NO_REST = { sumRadps: [0, 0, 0], count: 0 };

/**
 * The sensors evenly sampled at their own rate, with what points up at each time.
 * @param {Imu} imu @param {MotionParameters} parameters
 * @param {Rest} rested rates of turn at rest before these rows
 * @returns {Level}
 */
export function level(imu, parameters, rested = NO_REST) {
  const { tS, accel, gyro } = evenlySampled(imu);
  const rateHz = rateOf(tS);
  const isStill = stillRows(accel, gyro, rateHz, parameters);
  const bias = meanOf(restUntil(gyro, isStill, isStill.length, rested));
  const turn = gyro.map((axis, k) => axis.map((value) => value - bias[k]));
  const up = upInPhone(accel, turn, rateHz, parameters);
  return { tS, accel, gyro: turn, up, rateHz, biased: gyro, isStill };
}

/** @param {ArrayLike<number>} tS @returns {number} the usual rate of samples at these times */
export function rateOf(tS) {
  return 1 / median(differences(tS));
}

/**
 * Running mean over a window of time.
 * @param {Float64Array} values @param {number} windowS @param {number} rateHz @returns {Float64Array}
 */
export function averaged(values, windowS, rateHz) {
  return runningMean(values, Math.max(1, roundHalfEven(windowS * rateHz)), "nearest");
}

/** @param {Imu} imu @returns {{tS: Float64Array, accel: Axes, gyro: Axes}} on an even grid at their own rate */
export function evenlySampled({ tS, accelMps2, gyroRadps }) {
  const rateHz = rateOf(tS);
  const count = Math.trunc((tS[tS.length - 1] - tS[0]) * rateHz) + 1;
  const even = Float64Array.from({ length: count }, (_, k) => tS[0] + k / rateHz);
  /** @param {ArrayLike<number>} rows */
  const onGrid = (rows) => columnsOf(rows).map((column) => interpolateAll(even, tS, column));
  return { tS: even, accel: onGrid(accelMps2), gyro: onGrid(gyroRadps) };
}

/**
 * Rates of turn at rest before a time, on top of those before the rows.
 * @param {Axes} gyro with its bias @param {boolean[]} isStill @param {number} stop row @param {Rest} before
 * @returns {Rest}
 */
export function restUntil(gyro, isStill, stop, before) {
  const sumRadps = [...before.sumRadps];
  let { count } = before;
  for (let k = 0; k < stop; k += 1) {
    if (!isStill[k]) continue;
    count += 1;
    gyro.forEach((axis, n) => (sumRadps[n] += axis[k]));
  }
  return { sumRadps, count };
}

/** @param {Rest} rest @returns {number[]} zeros where there was none */
function meanOf({ sumRadps, count }) {
  return sumRadps.map((sum) => (count ? sum / count : 0));
}

/**
 * The gyroscope carries the phone into a frame that barely moves, where a slow low-pass without delay
 * leaves of the acceleration only gravity, however the phone is turned meanwhile.
 * @param {Axes} accel @param {Axes} gyro @param {number} rateHz @param {MotionParameters} parameters
 * @returns {Axes} unit vectors that point up, in phone axes
 */
function upInPhone(accel, gyro, rateHz, parameters) {
  const count = accel[0].length;
  const sections = lowPass(parameters.gravity_cutoff_hz, rateHz);
  const padding = Math.min(count - 1, roundHalfEven(rateHz / parameters.gravity_cutoff_hz));
  const turns = turnsSinceFirst(gyro, rateHz);
  const fixed = turned(turns, accel, 1).map((axis) => zeroPhase(sections, axis, padding, "even"));
  const up = turned(turns, fixed, -1);
  for (let k = 0; k < count; k += 1) {
    const length = Math.sqrt(up[0][k] ** 2 + up[1][k] ** 2 + up[2][k] ** 2);
    for (let axis = 0; axis < 3; axis += 1) up[axis][k] /= length;
  }
  return up;
}

/**
 * How the phone has turned since the first row, as quaternions x y z w.
 * @param {Axes} gyro @param {number} rateHz @returns {Float64Array} (4n)
 */
function turnsSinceFirst([gx, gy, gz], rateHz) {
  const turns = new Float64Array(4 * gx.length);
  turns[3] = 1;
  for (let k = 1; k < gx.length; k += 1) {
    const x = (gx[k] + gx[k - 1]) / 2 / rateHz;
    const y = (gy[k] + gy[k - 1]) / 2 / rateHz;
    const z = (gz[k] + gz[k - 1]) / 2 / rateHz;
    const angle = Math.sqrt(x * x + y * y + z * z);
    const share = angle < 1e-9 ? 0.5 : Math.sin(angle / 2) / angle;
    turnOn(turns, 4 * k, share * x, share * y, share * z, Math.cos(angle / 2));
  }
  return turns;
}

/**
 * Writes the quaternion at `to`: the one before it, and then a turn a b c d.
 * @param {Float64Array} turns @param {number} to
 * @param {number} a @param {number} b @param {number} c @param {number} d
 */
function turnOn(turns, to, a, b, c, d) {
  const x = turns[to - 4];
  const y = turns[to - 3];
  const z = turns[to - 2];
  const w = turns[to - 1];
  turns[to] = w * a + x * d + y * c - z * b;
  turns[to + 1] = w * b - x * c + y * d + z * a;
  turns[to + 2] = w * c + x * b - y * a + z * d;
  turns[to + 3] = w * d - x * a - y * b - z * c;
}

/**
 * Rows turned by quaternions, or back where `sense` is -1.
 * @param {Float64Array} turns @param {Axes} rows @param {number} sense @returns {Axes}
 */
function turned(turns, [vx, vy, vz], sense) {
  const out = [0, 1, 2].map(() => new Float64Array(vx.length));
  for (let k = 0; k < vx.length; k += 1) {
    const x = sense * turns[4 * k];
    const y = sense * turns[4 * k + 1];
    const z = sense * turns[4 * k + 2];
    const w = turns[4 * k + 3];
    const tx = 2 * (y * vz[k] - z * vy[k]);
    const ty = 2 * (z * vx[k] - x * vz[k]);
    const tz = 2 * (x * vy[k] - y * vx[k]);
    out[0][k] = vx[k] + w * tx + y * tz - z * ty;
    out[1][k] = vy[k] + w * ty + z * tx - x * tz;
    out[2][k] = vz[k] + w * tz + x * ty - y * tx;
  }
  return out;
}

/**
 * Rows inside stretches where the phone hardly shakes or turns for long enough. One in a hand turns
 * slowly for as long as it is held, which is no bias: its tremor tells.
 * @param {Axes} accel @param {Axes} gyro @param {number} rateHz @param {MotionParameters} parameters
 * @returns {boolean[]}
 */
export function stillRows(accel, gyro, rateHz, parameters) {
  const window = Math.max(1, roundHalfEven(parameters.still_s * rateHz));
  const [shake, tremor] = [accel, gyro].map((rows) => rows.map((axis) => {
    const mean = runningMean(axis, window, "reflect");
    return axis.map((value, k) => value - mean[k]);
  }));
  /** @param {Axes} rows @param {number} k */
  const length = ([x, y, z], k) => Math.sqrt(x[k] * x[k] + y[k] * y[k] + z[k] * z[k]);
  const isCalm = Array.from(accel[0], (_, k) => (
    length(shake, k) < parameters.still_accel_mps2
    && length(tremor, k) < parameters.still_tremor_radps
    && length(gyro, k) < parameters.still_gyro_radps
  ));
  return inRunsOf(isCalm, window);
}

/**
 * True where it is true for `least` rows on end.
 * @param {boolean[]} isTrue @param {number} least @returns {boolean[]}
 */
export function inRunsOf(isTrue, least) {
  const out = new Array(isTrue.length).fill(false);
  let begun = 0;
  for (let k = 0; k <= isTrue.length; k += 1) {
    if (k < isTrue.length && isTrue[k]) continue;
    if (k - begun >= least) out.fill(true, begun, k);
    begun = k + 1;
  }
  return out;
}

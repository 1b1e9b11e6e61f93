/** Filters without delay: Butterworth sections run to and fro, running means and medians, as in scipy. */

import { median } from "../matched_filter.js";

/** @typedef {{b: number[], a: number[]}} Section of second order: b0 b1 b2 over 1 a1 a2; `a` without the 1 */

/**
 * A first-order Butterworth low-pass, by the bilinear transform.
 * @param {number} cutoffHz @param {number} rateHz @returns {Section[]}
 */
export function lowPass(cutoffHz, rateHz) {
  const warped = Math.tan((Math.PI * cutoffHz) / rateHz);
  const gain = warped / (1 + warped);
  return [{ b: [gain, gain, 0], a: [(warped - 1) / (warped + 1), 0] }];
}

/**
 * A Butterworth band-pass of two orders per edge: two sections, each with a zero at rest and one at half
 * the rate.
 * @param {number} lowHz @param {number} highHz @param {number} rateHz @returns {Section[]}
 */
export function bandPass(lowHz, highHz, rateHz) {
  const [low, high] = [lowHz, highHz].map((hz) => 4 * Math.tan((Math.PI * hz) / rateHz));
  const width = high - low;
  return analogPoles(width, low * high).map((pole) => {
    const { re, im, share } = bilinear(pole);
    return { b: [share * width, 0, -share * width], a: [-2 * re, re * re + im * im] };
  });
}

/** @typedef {{re: number, im: number}} Pole */

/** One of each conjugate pair of poles of the analog band-pass. @param {number} width @param {number} centre2 */
function analogPoles(width, centre2) {
  const half = (width / 2) * Math.SQRT1_2;
  const root = squareRoot({ re: -centre2, im: -2 * half * half });
  return [{ re: root.re - half, im: root.im + half }, { re: -root.re - half, im: half - root.im }];
}

/** @param {Pole} value */
function squareRoot({ re, im }) {
  const size = Math.sqrt(Math.hypot(re, im));
  const half = Math.atan2(im, re) / 2;
  return { re: size * Math.cos(half), im: size * Math.sin(half) };
}

/** A pole in the plane of z, and its pair's share of the gain. @param {Pole} pole */
function bilinear({ re, im }) {
  const below = (4 - re) ** 2 + im ** 2;
  return {
    re: (16 - re * re - im * im) / below,
    im: (8 * im) / below,
    share: 4 / below,
  };
}

/**
 * Filtered forwards and backwards, begun in the steady state of the first value.
 * @param {Section[]} sections
 * @param {Float64Array} values more than `padding`
 * @param {number} padding how many are mirrored beyond each end
 * @param {"even" | "odd"} mirror about the end's time, or about its value too
 * @returns {Float64Array}
 */
export function zeroPhase(sections, values, padding, mirror) {
  const padded = mirrored(values, padding, mirror);
  const forth = filtered(sections, padded).reverse();
  const back = filtered(sections, forth).reverse();
  return back.slice(padding, padding + values.length);
}

/** Samples that scipy.signal.sosfiltfilt mirrors when not told how many. @param {Section[]} sections */
export function usualPadding(sections) {
  return 3 * (2 * sections.length + 1);
}

/** @param {Float64Array} values @param {number} padding @param {"even" | "odd"} mirror */
function mirrored(values, padding, mirror) {
  const count = values.length;
  if (count <= padding) {
    throw new RangeError(`filter: got ${count} values, wanted more than ${padding}; record longer`);
  }
  const out = new Float64Array(count + 2 * padding);
  out.set(values, padding);
  const [first, last] = [values[0], values[count - 1]];
  for (let k = 1; k <= padding; k += 1) {
    const [before, after] = [values[k], values[count - 1 - k]];
    out[padding - k] = mirror === "odd" ? 2 * first - before : before;
    out[padding + count - 1 + k] = mirror === "odd" ? 2 * last - after : after;
  }
  return out;
}

/** @param {Section[]} sections @param {Float64Array} values */
function filtered(sections, values) {
  let out = values;
  for (const section of sections) out = throughSection(section, out);
  return out;
}

/** @param {Section} section @param {Float64Array} values */
function throughSection({ b, a }, values) {
  const out = new Float64Array(values.length);
  const settled = (b[0] + b[1] + b[2]) / (1 + a[0] + a[1]);
  let first = (settled - b[0]) * values[0];
  let second = (b[2] - a[1] * settled) * values[0];
  for (let k = 0; k < values.length; k += 1) {
    const y = b[0] * values[k] + first;
    first = b[1] * values[k] - a[0] * y + second;
    second = b[2] * values[k] - a[1] * y;
    out[k] = y;
  }
  return out;
}

/**
 * The mean over `size` values around each, an even size reaching one further back.
 * @param {Float64Array} values @param {number} size
 * @param {"nearest" | "reflect"} beyond what stands beyond the ends
 * @returns {Float64Array}
 */
export function runningMean(values, size, beyond) {
  const count = values.length;
  const at = beyond === "nearest" ? nearest : reflected;
  const before = size >> 1;
  const extended = Float64Array.from({ length: count + size }, (_, k) => values[at(k - before, count)]);
  let sum = 0;
  for (let k = 0; k < size; k += 1) sum += extended[k];
  const out = new Float64Array(count);
  for (let k = 0; k < count; k += 1) {
    out[k] = sum / size;
    sum += extended[k + size] - extended[k];
  }
  return out;
}

/** @param {Float64Array} values @param {number} size odd @returns {Float64Array} the median around each */
export function runningMedian(values, size) {
  const reach = size >> 1;
  return values.map((_, k) => {
    const around = Float64Array.from({ length: size }, (__, j) => values[nearest(k + j - reach, values.length)]);
    return around.sort()[reach];
  });
}

/** @param {number} k @param {number} count */
function nearest(k, count) {
  return Math.min(Math.max(k, 0), count - 1);
}

/** @param {number} k @param {number} count */
function reflected(k, count) {
  const period = 2 * count;
  const turned = ((k % period) + period) % period;
  return turned < count ? turned : period - 1 - turned;
}

// Values over time, as numpy treats them: rounding, medians, differences and interpolation.

/** @param {number} value @returns {number} the nearest whole number, halves to the even one */
export function roundHalfEven(value) {
  const below = Math.floor(value);
  const over = value - below;
  if (over !== 0.5) return Math.round(value);
  return below % 2 === 0 ? below : below + 1;
}

/** @param {ArrayLike<number>} values (n) @returns {Float64Array} (n-1) */
export function differences(values) {
  return Float64Array.from({ length: Math.max(values.length - 1, 0) }, (_, k) => values[k + 1] - values[k]);
}

/** @param {ArrayLike<number>} values (n) @returns {Float64Array} (n-1) the middle of each and the next */
export function halfways(values) {
  return Float64Array.from({ length: Math.max(values.length - 1, 0) }, (_, k) => (values[k + 1] + values[k]) / 2);
}

/** @param {ArrayLike<number>} sorted @param {number} value @returns {number} how many are not above it */
function countUpTo(sorted, value) {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * Values at a time, linear between the rows and constant beyond them.
 * @param {number} atS @param {ArrayLike<number>} tS increasing @param {ArrayLike<number>} values
 */
export function interpolate(atS, tS, values) {
  const next = countUpTo(tS, atS);
  if (next === 0) return values[0];
  if (next === tS.length) return values[next - 1];
  const slope = (values[next] - values[next - 1]) / (tS[next] - tS[next - 1]);
  return values[next - 1] + slope * (atS - tS[next - 1]);
}

/**
 * The same at many times.
 * @param {ArrayLike<number>} times increasing @param {ArrayLike<number>} tS @param {ArrayLike<number>} values
 * @returns {Float64Array}
 */
export function interpolateAll(times, tS, values) {
  const out = new Float64Array(times.length);
  const last = tS.length - 1;
  for (let k = 0, row = 0; k < out.length; k += 1) {
    while (row < last && tS[row + 1] <= times[k]) row += 1;
    if (row === last || times[k] < tS[0]) {
      out[k] = values[row];
      continue;
    }
    const slope = (values[row + 1] - values[row]) / (tS[row + 1] - tS[row]);
    out[k] = values[row] + slope * (times[k] - tS[row]);
  }
  return out;
}

/** @param {ArrayLike<number>} rows (3n) x, y, z by turns @returns {Float64Array[]} a column per axis */
export function columnsOf(rows) {
  const count = rows.length / 3;
  return [0, 1, 2].map((axis) => Float64Array.from({ length: count }, (_, k) => rows[3 * k + axis]));
}

/** @param {number} angleRad @returns {number} the same angle in [-pi, pi) */
export function wrapAngle(angleRad) {
  const full = 2 * Math.PI;
  const turned = (angleRad + Math.PI) % full;
  return (turned < 0 ? turned + full : turned) - Math.PI;
}

/**
 * What the stages of motion pass on. All times are seconds on the clock of the sound.
 *
 * @typedef {{tS: ArrayLike<number>, accelMps2: ArrayLike<number>, gyroRadps: ArrayLike<number>}} Imu
 *   times (n), increasing; acceleration with gravity and rate of turn (3n), x y z by turns, phone axes
 * @typedef {Float64Array[]} Axes three columns (n): x, y, z
 * @typedef {{sumRadps: number[], count: number}} Rest rates of turn summed over so many rows at rest
 * @typedef {{tS: Float64Array, accel: Axes, gyro: Axes, up: Axes, rateHz: number, biased: Axes,
 *   isStill: boolean[]}} Level even rows; the gyroscope without its bias, and with it; `up` of length 1
 * @typedef {{tS: number, fromS: number, moveM: number[], sigma: number[]}} Step from one footstep to the
 *   next: forward m, left m, turn rad, seen from the first, and the sigma of each
 * @typedef {{
 *   bounce_law_sigma: number, bounce_law_sigma_if_slow: number,
 *   bounce_window_s: number, cadence_high_hz: number, cadence_low_hz: number, forward_sigma: number,
 *   gravity_cutoff_hz: number, heading_sigma_rad: number, heading_window_s: number, lateral_sigma: number,
 *   least_bounce_mps2: number, least_duration_s: number, least_interval_s: number,
 *   least_rate_hz: number, length_power_of_bounce: number, length_power_of_cadence: number,
 *   length_window_s: number, live_delay_s: number, live_window_s: number, longest_gap_s: number,
 *   longest_step_m: number, pause_intervals: number, pause_length_m: number, relative_bounce: number,
 *   setting_off_sigma_rad: number, shortest_step_m: number, step_length_m: number, step_scale: number,
 *   still_accel_mps2: number, still_gyro_radps: number, still_s: number, still_tremor_radps: number,
 *   typical_bounce_mps2: number, typical_cadence_hz: number, walk_ratio_m_per_hz: number, walk_ratio_sigma: number,
 * }} MotionParameters the group "motion", as far as pages need it
 */
/** The inertial sensors on an even clock, with the direction that points up: elfslam.stages.motion.level. */

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

/** Filters without delay: Butterworth sections run to and fro, running means and medians, as in scipy. */

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

/** @param {ArrayLike<number>} values @returns {number} NaN where there are none */
export function median(values) {
  const sorted = Float64Array.from(values).sort();
  const middle = sorted.length >> 1;
  if (sorted.length === 0) return NaN;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
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
export {};

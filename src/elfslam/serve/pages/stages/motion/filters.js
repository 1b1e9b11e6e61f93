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

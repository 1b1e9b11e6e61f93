/**
 * The matched filter. One cycle at 17.5 kHz is 2.5 samples, so a raw correlation peak picks the wrong
 * cycle: what counts is the envelope of the analytic filter, as in elfslam.stages.echo.
 */

import { ECHO_RATE_HZ } from "./constants.js";
import { joined } from "./resample.js";

/**
 * A matched filter for blocks of up to `most` samples. Value k of its envelope belongs to a chirp that
 * starts at sample k and is 1 for a chirp of amplitude 1; a block of n samples has n - chirp + 1.
 * @param {Float32Array} chirp
 * @param {number} most
 * @returns {(block: ArrayLike<number>) => Float32Array}
 */
export function makeMatchedFilter(chirp, most) {
  const size = powerOfTwo(most);
  const fourier = fourierOf(size);
  const kernel = kernelSpectrum(chirp, size, fourier);
  return (block) => {
    const x = complexZeros(size);
    x.re.set(block);
    fourier.forward(x);
    multiply(x, kernel);
    fourier.inverse(x);
    const envelope = new Float32Array(Math.max(block.length - chirp.length + 1, 0));
    for (let k = 0; k < envelope.length; k += 1) envelope[k] = Math.hypot(x.re[k], x.im[k]);
    return envelope;
  };
}

/**
 * The conjugate of the analytic chirp's spectrum, over the chirp's energy.
 * @param {Float32Array} chirp @param {number} size @param {ReturnType<typeof fourierOf>} fourier
 */
function kernelSpectrum(chirp, size, fourier) {
  const analytic = analyticSignal(chirp);
  const energy = chirp.reduce((sum, value) => sum + value * value, 0);
  const kernel = complexZeros(size);
  kernel.re.set(analytic.re);
  kernel.im.set(analytic.im);
  fourier.forward(kernel);
  for (let k = 0; k < size; k += 1) {
    kernel.re[k] /= energy;
    kernel.im[k] /= -energy;
  }
  return kernel;
}

/**
 * Multiplies x by y, in place.
 * @param {Complex} x @param {Complex} y
 */
function multiply(x, y) {
  for (let k = 0; k < x.re.length; k += 1) {
    const re = x.re[k] * y.re[k] - x.im[k] * y.im[k];
    x.im[k] = x.re[k] * y.im[k] + x.im[k] * y.re[k];
    x.re[k] = re;
  }
}

/** @param {ArrayLike<number>} values @returns {number} index of the greatest in [start, stop) */
export function strongest(values, start = 0, stop = values.length) {
  let best = Math.max(start, 0);
  for (let k = best; k < Math.min(stop, values.length); k += 1) {
    if (values[k] > values[best]) best = k;
  }
  return best;
}

/**
 * The first local peak at most `early` samples before `peak` that is at least `share` as strong, or
 * `peak`: an echo may be louder than the direct sound.
 * @param {ArrayLike<number>} envelope @param {number} peak @param {number} early @param {number} share
 */
export function earliest(envelope, peak, early, share) {
  for (let k = Math.max(peak - early, 1); k < peak; k += 1) {
    const rising = envelope[k] >= envelope[k - 1] && envelope[k] > envelope[k + 1];
    if (rising && envelope[k] >= share * envelope[peak]) return k;
  }
  return peak;
}

/** @param {ArrayLike<number>} values @returns {number} NaN where there are none */
export function median(values) {
  const sorted = Float64Array.from(values).sort();
  const middle = sorted.length >> 1;
  if (sorted.length === 0) return NaN;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

// The discrete Fourier transform, as far as a matched filter and a spectrum need it.

/** @typedef {{re: Float64Array, im: Float64Array}} Complex */

/** @param {number} size @returns {Complex} zeros */
export function complexZeros(size) {
  return { re: new Float64Array(size), im: new Float64Array(size) };
}

/**
 * Transforms of one size, a power of two; both work in place and the inverse divides by the size.
 * @param {number} size
 * @returns {{forward: (x: Complex) => Complex, inverse: (x: Complex) => Complex}}
 */
export function fourierOf(size) {
  if (size < 2 || (size & (size - 1)) !== 0) {
    throw new RangeError(`Fourier transform: wanted a power of two, got ${size}`);
  }
  const turn = rootsOfUnity(size);
  /** @param {Complex} x */
  const forward = (x) => butterflies(reorder(x), turn);
  /** @param {Complex} x */
  const inverse = ({ re, im }) => {
    forward({ re: im, im: re });
    for (let k = 0; k < size; k += 1) {
      re[k] /= size;
      im[k] /= size;
    }
    return { re, im };
  };
  return { forward, inverse };
}

/** @param {number} least @returns {number} the power of two that holds so many samples */
function powerOfTwo(least) {
  return 2 ** Math.ceil(Math.log2(least));
}

/**
 * The analytic signal of a few real samples of any count, as scipy.signal.hilbert makes it.
 * @param {ArrayLike<number>} samples
 * @returns {Complex}
 */
export function analyticSignal(samples) {
  const count = samples.length;
  const { re: cos, im: sin } = rootsOfUnity(count, count);
  const out = complexZeros(count);
  for (let f = 0; f <= count / 2; f += 1) {
    let re = 0;
    let im = 0;
    for (let n = 0; n < count; n += 1) {
      re += samples[n] * cos[(f * n) % count];
      im += samples[n] * sin[(f * n) % count];
    }
    const weight = (f === 0 || 2 * f === count ? 1 : 2) / count;
    for (let n = 0; n < count; n += 1) {
      const c = cos[(f * n) % count];
      const s = sin[(f * n) % count];
      out.re[n] += weight * (re * c + im * s);
      out.im[n] += weight * (im * c - re * s);
    }
  }
  return out;
}

/** exp(-2 pi i k / size) for k below `count`. @param {number} size @returns {Complex} */
function rootsOfUnity(size, count = size / 2) {
  const roots = complexZeros(count);
  for (let k = 0; k < count; k += 1) {
    roots.re[k] = Math.cos((2 * Math.PI * k) / size);
    roots.im[k] = -Math.sin((2 * Math.PI * k) / size);
  }
  return roots;
}

/** Samples to where the butterflies want them. @param {Complex} x @returns {Complex} */
function reorder({ re, im }) {
  const size = re.length;
  for (let i = 1, j = 0; i < size; i += 1) {
    let bit = size >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) {
      [re[i], re[j]] = [re[j], re[i]];
      [im[i], im[j]] = [im[j], im[i]];
    }
  }
  return { re, im };
}

/** @param {Complex} x @param {Complex} turn roots of unity @returns {Complex} */
function butterflies({ re, im }, turn) {
  const size = re.length;
  for (let half = 1; half < size; half *= 2) {
    const stride = size / (2 * half);
    for (let start = 0; start < size; start += 2 * half) {
      for (let k = 0; k < half; k += 1) {
        const a = start + k;
        const b = a + half;
        const c = turn.re[k * stride];
        const s = turn.im[k * stride];
        const bRe = re[b] * c - im[b] * s;
        const bIm = re[b] * s + im[b] * c;
        re[b] = re[a] - bRe;
        im[b] = im[a] - bIm;
        re[a] += bRe;
        im[a] += bIm;
      }
    }
  }
  return { re, im };
}

// The envelope of the matched filter, block by block, as elfslam.stages.echo makes it at 44.1 kHz.

/**
 * `push` takes the next samples and gives the values that have become final. They come in
 * blocks that begin at the same samples however the sound is cut, so that they are the same to the last
 * bit; no echo waits for them, as it ends later than its block. `end` gives the rest, as if silence
 * followed. Value k belongs to a chirp that starts at sample k.
 * @typedef {{push: (samples: Float32Array) => Float32Array, end: () => Float32Array}} Envelope
 */

/** @param {Float32Array} template the chirp, at the rate of the samples @returns {Envelope} */
export function makeEnvelope(template) {
  const size = powerOfTwo(4 * template.length);
  const filter = makeMatchedFilter(template, size);
  const block = size - template.length + 1;
  /** @type {Float32Array} */
  let held = new Float32Array(0);

  /** @param {Float32Array} samples */
  const push = (samples) => {
    held = joined(held, samples);
    const blocks = Math.max(Math.floor((held.length - template.length + 1) / block), 0);
    const out = new Float32Array(blocks * block);
    for (let k = 0; k < blocks; k += 1) {
      out.set(filter(held.subarray(k * block, k * block + size)), k * block);
    }
    held = held.slice(blocks * block);
    return out;
  };

  const end = () => {
    const wanted = held.length;
    return push(new Float32Array(size)).slice(0, wanted);
  };

  return { push, end };
}

/**
 * The template as scipy.signal.resample takes it from one rate to a lower one: by its spectrum.
 * @param {Float32Array} chirp @param {number} rateHz @returns {Float32Array}
 */
export function atEchoRate(chirp, rateHz) {
  const count = Math.round((chirp.length * ECHO_RATE_HZ) / rateHz);
  if (count === chirp.length) return chirp;
  const out = new Float32Array(count);
  const spectrum = lowSpectrum(chirp, Math.floor((count - 1) / 2));
  for (let n = 0; n < count; n += 1) {
    let sum = spectrum.re[0];
    for (let f = 1; f < spectrum.re.length; f += 1) {
      const angle = (2 * Math.PI * ((f * n) % count)) / count;
      sum += 2 * (spectrum.re[f] * Math.cos(angle) - spectrum.im[f] * Math.sin(angle));
    }
    out[n] = sum / chirp.length;
  }
  return out;
}

/** @param {Float32Array} samples @param {number} highest frequency */
function lowSpectrum(samples, highest) {
  const spectrum = complexZeros(highest + 1);
  for (let f = 0; f <= highest; f += 1) {
    for (let n = 0; n < samples.length; n += 1) {
      const angle = (2 * Math.PI * ((f * n) % samples.length)) / samples.length;
      spectrum.re[f] += samples[n] * Math.cos(angle);
      spectrum.im[f] -= samples[n] * Math.sin(angle);
    }
  }
  return spectrum;
}

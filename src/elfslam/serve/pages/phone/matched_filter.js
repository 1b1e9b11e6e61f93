/**
 * The matched filter. One cycle at 17.5 kHz is 2.5 samples, so a raw correlation peak picks the wrong
 * cycle: what counts is the envelope of the analytic filter, as in elfslam.stages.echo.
 */

import { analyticSignal, complexZeros, fourierOf, powerOfTwo } from "./fourier.js";

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
 * @param {import("./fourier.js").Complex} x @param {import("./fourier.js").Complex} y
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
  const sorted = Array.from(values).sort((a, b) => a - b);
  const middle = sorted.length >> 1;
  if (sorted.length === 0) return NaN;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

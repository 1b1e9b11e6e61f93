/** The discrete Fourier transform, as far as a matched filter and a spectrum need it. */

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
export function powerOfTwo(least) {
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

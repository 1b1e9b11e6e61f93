/** The envelope of the matched filter, block by block, as elfslam.stages.echo makes it at 44.1 kHz. */

import { complexZeros, powerOfTwo } from "../phone/fourier.js";
import { makeMatchedFilter } from "../phone/matched_filter.js";
import { ECHO_RATE_HZ, joined } from "./resample.js";

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

/**
 * The chirp band alone, as elfslam.data.baseband keeps it: the analytic signal shifted down to zero,
 *
 *     b(t) = 2 sum_n x[n] exp(-2 pi i f n / F) h(t - n / F),
 *
 * at t = k / 6300 on the recording's own clock, in frames of 80 ms.
 */

import { BASEBAND_FILTER, BASEBAND_FORMAT } from "../stages/constants.js";

export const BASEBAND = {
  rateHz: BASEBAND_FORMAT.rate_hz, centreHz: BASEBAND_FORMAT.centre_hz, frameSamples: BASEBAND_FORMAT.frame_samples,
  leadS: BASEBAND_FORMAT.lead_s,
};
/** KAISER_SHAPE: speech is taken down by 160 dB, far below what a microphone's own noise hides; LEAST: silence has a scale too. */
const { HALF_SUPPORT_S, KAISER_SHAPE, LEAST } = BASEBAND_FILTER;
const LARGEST_INT16 = 32767;

/**
 * @typedef {{
 *   firstIndex: (direct: number) => number,
 *   needs: (k: number) => [number, number],
 *   frame: (samples: Float32Array, first: number, k: number) => Float64Array,
 * }} Baseband firstIndex: where on the grid the frame of a direct arrival begins; needs: the samples
 *   [first, last + 1) that the frame from k on is made of; frame: I and Q by turns (2 x 504), from
 *   samples of which the first is sample `first` of the recording.
 * @typedef {{offset: number, taps: Float64Array}} Phase
 * @typedef {{size: number, cos: Float64Array, sin: Float64Array}} Mixer
 */

/** @param {number} rateHz 44100 or 48000 @returns {Baseband} */
export function makeBaseband(rateHz) {
  const common = greatestCommonDivisor(BASEBAND.rateHz, rateHz);
  const up = BASEBAND.rateHz / common;
  const down = rateHz / common;
  const half = Math.round(HALF_SUPPORT_S * rateHz * up);
  const phases = makePhases(rateHz, up, half);
  const mixer = makeMixer(rateHz);
  /** @param {number} k */
  const position = (k) => Math.floor((k * down) / up);
  const reach = Math.floor(half / up);
  return {
    firstIndex: (direct) => firstIndex(direct, rateHz),
    needs: (k) => [position(k) - reach, position(k + BASEBAND.frameSamples - 1) + reach + 2],
    frame: (samples, first, k) => filterFrame(samples, first, k, { up, down, phases, mixer }),
  };
}

/** @param {Float64Array} frame @param {number} scale @returns {Int16Array} frame / scale, held to 16 bits */
export function toInt16(frame, scale) {
  return Int16Array.from(frame, (value) => {
    const step = Math.round(value / scale);
    return Math.max(-LARGEST_INT16, Math.min(LARGEST_INT16, step));
  });
}

/**
 * What one step of the 16 bits stands for: the least that clips nothing of this frame.
 * @param {Float64Array} frame
 */
export function scaleOf(frame) {
  const largest = frame.reduce((most, value) => Math.max(most, Math.abs(value)), 0);
  return Math.max(largest, LEAST) / LARGEST_INT16;
}

/** @param {number} direct @param {number} rateHz */
function firstIndex(direct, rateHz) {
  return Math.max(Math.round((direct / rateHz - BASEBAND.leadS) * BASEBAND.rateHz), 0);
}

/**
 * The filter at one phase per output: taps for n = floor(position) + offset.
 * @param {number} rateHz @param {number} up @param {number} half
 * @returns {Phase[]}
 */
function makePhases(rateHz, up, half) {
  return Array.from({ length: up }, (_, phase) => {
    const offset = Math.ceil((phase - half) / up);
    const count = Math.floor((phase + half) / up) - offset + 1;
    const taps = Float64Array.from({ length: count }, (_, j) =>
      impulseResponse(phase - (offset + j) * up, rateHz, up, half),
    );
    return { offset, taps };
  });
}

/**
 * 2 h at the time step / (rateHz up); half: steps from the middle to the end.
 * @param {number} step @param {number} rateHz @param {number} up @param {number} half
 */
function impulseResponse(step, rateHz, up, half) {
  const x = (Math.PI * BASEBAND.rateHz * step) / (rateHz * up);
  const sinc = step === 0 ? 1 : Math.sin(x) / x;
  return ((2 * BASEBAND.rateHz) / rateHz) * sinc * kaiser(step / half);
}

/** @param {number} x in [-1, 1] */
function kaiser(x) {
  return bessel(KAISER_SHAPE * Math.sqrt(Math.max(1 - x * x, 0))) / bessel(KAISER_SHAPE);
}

/** Modified Bessel function of the first kind, order 0, by its series. @param {number} x */
function bessel(x) {
  let term = 1;
  let sum = 1;
  for (let k = 1; term > 1e-16 * sum; k += 1) {
    term *= (x / (2 * k)) ** 2;
    sum += term;
  }
  return sum;
}

/** exp(-2 pi i f n / F) over its period. @param {number} rateHz @returns {Mixer} */
function makeMixer(rateHz) {
  const size = rateHz / greatestCommonDivisor(BASEBAND.centreHz, rateHz);
  /** @param {number} n */
  const turn = (n) => (-2 * Math.PI * ((n * BASEBAND.centreHz) % rateHz)) / rateHz;
  return {
    size,
    cos: Float64Array.from({ length: size }, (_, n) => Math.cos(turn(n))),
    sin: Float64Array.from({ length: size }, (_, n) => Math.sin(turn(n))),
  };
}

/**
 * @param {Float32Array} samples @param {number} first @param {number} k
 * @param {{up: number, down: number, phases: Phase[], mixer: Mixer}} given
 */
function filterFrame(samples, first, k, { up, down, phases, mixer }) {
  const mixed = mix(samples, first, mixer);
  const out = new Float64Array(2 * BASEBAND.frameSamples);
  for (let j = 0; j < BASEBAND.frameSamples; j += 1) {
    const at = (k + j) * down;
    const { offset, taps } = phases[at % up];
    const start = Math.floor(at / up) + offset - first;
    for (let t = 0; t < taps.length; t += 1) {
      const n = start + t;
      if (n < 0 || n >= samples.length) continue;
      out[2 * j] += taps[t] * mixed.re[n];
      out[2 * j + 1] += taps[t] * mixed.im[n];
    }
  }
  return out;
}

/** @param {Float32Array} samples @param {number} first @param {Mixer} mixer */
function mix(samples, first, { size, cos, sin }) {
  const re = new Float64Array(samples.length);
  const im = new Float64Array(samples.length);
  for (let n = 0; n < samples.length; n += 1) {
    const turn = (((first + n) % size) + size) % size;
    re[n] = samples[n] * cos[turn];
    im[n] = samples[n] * sin[turn];
  }
  return { re, im };
}

/** @param {number} a @param {number} b @returns {number} */
function greatestCommonDivisor(a, b) {
  return b === 0 ? a : greatestCommonDivisor(b, a % b);
}

// The chirp band as plain sound: the same filter as the baseband's, without moving the band,
//
// y[n] = 2 sum_m x[m] h((n - m) / F) cos(2 pi f (n - m) / F).
//
// Its taps are the same both ways from the middle, so nothing is delayed and no phase is turned.

/**
 * @typedef {{reach: number, apply: (samples: Float32Array) => Float32Array}} BandFilter reach: samples
 *   that are needed on either side; apply: the band, as many samples shorter at both ends
 */

/** @param {number} rateHz 44100 or 48000 @returns {BandFilter} */
export function makeBandFilter(rateHz) {
  const reach = Math.round(HALF_SUPPORT_S * rateHz);
  const taps = Float64Array.from({ length: reach + 1 }, (_, k) => {
    const turn = (2 * Math.PI * BASEBAND.centreHz * k) / rateHz;
    return impulseResponse(k, rateHz, 1, reach) * Math.cos(turn);
  });
  return { reach, apply: (samples) => filtered(samples, taps, reach) };
}

/** @param {Float32Array} samples @param {Float64Array} taps @param {number} reach */
function filtered(samples, taps, reach) {
  const out = new Float32Array(Math.max(samples.length - 2 * reach, 0));
  for (let n = 0; n < out.length; n += 1) {
    const middle = n + reach;
    let sum = taps[0] * samples[middle];
    for (let k = 1; k <= reach; k += 1) {
      sum += taps[k] * (samples[middle - k] + samples[middle + k]);
    }
    out[n] = sum;
  }
  return out;
}

/** Sound at 48 kHz as sound at 44.1 kHz, by the filter of elfslam.stages.echo, block by block. */

import { ECHO_RATE_HZ } from "./constants.js";
import { checkRate } from "./chirp.js";

const UP = 147;
const DOWN = 160;
/** Taps on either side, at UP times the incoming rate: a long filter, flat from 15 to 20 kHz. */
const HALF = 96 * DOWN;
const KAISER_SHAPE = 10;

/**
 * `push` takes the next samples and gives those at 44.1 kHz that have become final, 2.2 ms behind;
 * `end` gives the rest, as if silence followed. Sample k of what comes out lies at k / 44100 s.
 * @typedef {{push: (samples: Float32Array) => Float32Array, end: () => Float32Array}} Resampler
 */

/** @param {number} rateHz of what comes in, 44100 or 48000 @returns {Resampler} */
export function makeResampler(rateHz) {
  checkRate(rateHz);
  if (rateHz === ECHO_RATE_HZ) return { push: (samples) => samples, end: () => new Float32Array(0) };
  const bank = filterBank();
  /** @type {Float32Array} */
  let held = new Float32Array(bank.before);
  let heldFirst = -bank.before;
  let made = 0;

  /** @param {Float32Array} samples */
  const push = (samples) => {
    held = joined(held, samples);
    const count = finalCount(heldFirst + held.length - bank.after);
    const out = new Float32Array(Math.max(count - made, 0));
    for (let k = 0; k < out.length; k += 1) out[k] = bank.at(made + k, held, heldFirst);
    made += out.length;
    forget(Math.floor((made * DOWN) / UP) - bank.before);
    return out;
  };

  /** @param {number} before */
  const forget = (before) => {
    const count = Math.min(before - heldFirst, held.length);
    if (count <= 0) return;
    held = held.slice(count);
    heldFirst += count;
  };

  /** Python gives a sample for every moment before the end. */
  const end = () => {
    const wanted = Math.ceil(((heldFirst + held.length) * UP) / DOWN) - made;
    return push(new Float32Array(bank.after + 2)).slice(0, wanted);
  };

  return { push, end };
}

/** How many outgoing samples lie before incoming sample `next`. @param {number} next */
function finalCount(next) {
  return Math.ceil((next * UP) / DOWN);
}

/** The taps of each of UP phases in a row of their own, as they meet the incoming samples. */
function filterBank() {
  const taps = lowpass();
  const before = Math.floor(HALF / UP);
  const after = Math.floor((HALF + UP - 1) / UP);
  const width = 4 * Math.ceil((before + after + 1) / 4);
  const rows = new Float32Array(UP * width);
  for (let phase = 0; phase < UP; phase += 1) {
    for (let j = -before; j <= after; j += 1) {
      rows[phase * width + j + before] = UP * (taps[HALF + phase - j * UP] ?? 0);
    }
  }
  /** @param {number} k @param {Float32Array} held @param {number} heldFirst */
  const at = (k, held, heldFirst) => {
    const whole = Math.floor((k * DOWN) / UP);
    const row = (k * DOWN - whole * UP) * width;
    const from = whole - before - heldFirst;
    // Four sums at once: one alone would wait for itself.
    let [a, b, c, d] = [0, 0, 0, 0];
    for (let j = 0; j < width; j += 4) {
      a += rows[row + j] * held[from + j];
      b += rows[row + j + 1] * held[from + j + 1];
      c += rows[row + j + 2] * held[from + j + 2];
      d += rows[row + j + 3] * held[from + j + 3];
    }
    return a + b + (c + d);
  };
  return { before, after: width - before - 1, at };
}

/** scipy.signal.firwin(2 * HALF + 1, 1 / DOWN, window=("kaiser", KAISER_SHAPE)). */
function lowpass() {
  const taps = new Float64Array(2 * HALF + 1);
  const top = bessel(KAISER_SHAPE);
  for (let n = -HALF; n <= HALF; n += 1) {
    const x = (Math.PI * n) / DOWN;
    const window = bessel(KAISER_SHAPE * Math.sqrt(1 - (n / HALF) ** 2)) / top;
    taps[n + HALF] = ((n === 0 ? 1 : Math.sin(x) / x) / DOWN) * window;
  }
  const sum = taps.reduce((total, tap) => total + tap, 0);
  return taps.map((tap) => tap / sum);
}

/** The modified Bessel function of order zero. @param {number} x */
function bessel(x) {
  let term = 1;
  let sum = 1;
  for (let k = 1; term > 1e-17 * sum; k += 1) {
    term *= (x / (2 * k)) ** 2;
    sum += term;
  }
  return sum;
}

/** @param {Float32Array} a @param {Float32Array} b @returns {Float32Array} one behind the other */
export function joined(a, b) {
  const out = new Float32Array(a.length + b.length);
  out.set(a);
  out.set(b, a.length);
  return out;
}

// The microphone's stream as one line of samples, of which the beginning is forgotten as it goes.

/**
 * @typedef {{
 *   append: (first: number, samples: Float32Array) => number,
 *   slice: (from: number, to: number) => Float32Array,
 *   forget: (before: number) => void,
 *   end: () => number,
 * }} Stream append: adds samples that begin at sample `first`, silence where some are missing before
 *   them, and gives how many were missing; slice: copies [from, to), zeros where nothing is known.
 */

/**
 * @param {number} capacity samples that are remembered at least
 * @param {number} [origin] the sample at which it begins
 * @returns {Stream}
 */
export function makeStream(capacity, origin = 0) {
  let line = new Float32Array(2 * capacity);
  let start = origin;
  let end = origin;

  /** @param {number} count */
  const makeRoom = (count) => {
    if (end - start + count <= line.length) return;
    const wanted = Math.max(line.length, 2 * (end - start + count));
    const longer = new Float32Array(wanted);
    longer.set(line.subarray(0, end - start));
    line = longer;
  };

  /** @type {Stream["append"]} */
  const append = (first, samples) => {
    const missing = Math.max(first - end, 0);
    const late = Math.max(end - first, 0);
    makeRoom(missing + samples.length);
    line.fill(0, end - start, end - start + missing);
    end += missing;
    line.set(samples.subarray(late), end - start);
    end += Math.max(samples.length - late, 0);
    return missing;
  };

  /** @type {Stream["slice"]} */
  const slice = (from, to) => {
    const out = new Float32Array(to - from);
    const known = Math.max(from, start);
    if (known < Math.min(to, end)) {
      out.set(line.subarray(known - start, Math.min(to, end) - start), known - from);
    }
    return out;
  };

  /** @type {Stream["forget"]} */
  const forget = (before) => {
    const count = Math.min(Math.max(before - start, 0), end - start);
    if (count < capacity) return;
    line.copyWithin(0, count, end - start);
    start += count;
  };

  return { append, slice, forget, end: () => end };
}

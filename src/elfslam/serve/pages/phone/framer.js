/** From the stream to frames: finds the direct arrival of every chirp and cuts what is kept of it. */

import { makeMatchedFilter } from "../stages/matched_filter.js";
import { makeStream } from "../stages/resample.js";
import { NOTHING_YET, makeScheduled, nextArrival, wantedStretch } from "./arrivals.js";
import { BASEBAND, makeBandFilter, makeBaseband, scaleOf, toInt16 } from "./baseband.js";

const FRAME_S = 0.08;

/**
 * @typedef {"baseband" | "whole"} Kind how the chirp band is kept: as I and Q, or as sound
 * @typedef {import("./arrivals.js").Arrival & {played?: number}} Arrival played: where that was told
 * @typedef {{arrival: Arrival, tS: number, row: string, bytes: Uint8Array}} Frame
 * @typedef {{index: (direct: number) => number, lastNeeded: (direct: number) => number,
 *   cut: (stream: import("../stages/resample.js").Stream, index: number) => {tS: number, row: string, bytes: Uint8Array}}} Cutter
 * @typedef {{push: (first: number, samples: Float32Array) => {frames: Frame[], missing: number},
 *   played: (sample: number) => void, end: () => number,
 *   heard: import("../stages/hearing.js").HeardSound}} Framer
 *   played: tells when a chirp was played, before it can be heard; without it they come once per period
 */

/**
 * @param {{rateHz: number, chirp: Float32Array, period: number, kind: Kind, late?: number | null, origin?: number}} given
 *   period in samples; late: samples from playing to hearing, as far as that is known before one is heard;
 *   origin: the sample at which the stream begins
 * @returns {Framer}
 */
export function makeFramer({ rateHz, chirp, period, kind, late = null, origin = 0 }) {
  const stream = makeStream(4 * rateHz, origin);
  const envelopeOf = makeMatchedFilter(chirp, period + chirp.length);
  const cutter = kind === "baseband" ? basebandCutter(rateHz) : wholeCutter(rateHz);
  const scheduled = makeScheduled({ rateHz, chirp, period, guess: late ?? 0, origin });
  let search = NOTHING_YET;
  let hunted = origin;
  /** @type {Arrival[]} */
  const waiting = [];
  let last = -1;

  const findMore = () => {
    for (;;) {
      const [from, to] = wantedStretch(search, period, hunted);
      if (stream.end() < to + chirp.length) return;
      const envelope = envelopeOf(stream.slice(from, to + chirp.length - 1));
      const step = nextArrival(search, envelope, from, period, rateHz);
      search = step.search;
      hunted = to;
      if (step.arrival) waiting.push(step.arrival);
    }
  };

  const cutReady = () => {
    /** @type {Frame[]} */
    const frames = [];
    while (waiting.length > 0 && cutter.lastNeeded(waiting[0].sample) <= stream.end()) {
      const arrival = /** @type {Arrival} */ (waiting.shift());
      const index = cutter.index(arrival.sample);
      if (index <= last) continue;
      last = index;
      frames.push({ arrival, ...cutter.cut(stream, index) });
    }
    return frames;
  };

  /** @type {Framer["push"]} */
  const push = (first, samples) => {
    const begin = stream.end();
    const missing = stream.append(first, samples);
    waiting.push(...scheduled.push(stream.slice(begin, stream.end())));
    if (!scheduled.hasBegun() && late === null) findMore();
    const frames = cutReady();
    const due = scheduled.hasBegun() ? scheduled.needs() : (search.due ?? hunted);
    const oldest = Math.min(waiting[0]?.sample ?? due, due);
    stream.forget(oldest - Math.max(2 * period, rateHz));
    return { frames, missing };
  };

  return { push, played: scheduled.played, end: stream.end, heard: scheduled.heard };
}

/** @param {number} rateHz @returns {Cutter} */
function basebandCutter(rateHz) {
  const baseband = makeBaseband(rateHz);
  return {
    index: baseband.firstIndex,
    lastNeeded: (direct) => baseband.needs(baseband.firstIndex(direct))[1],
    cut: (stream, k) => {
      const [from, to] = baseband.needs(k);
      const values = baseband.frame(stream.slice(from, to), from, k);
      const tS = k / BASEBAND.rateHz;
      const scale = scaleOf(values);
      return { tS, row: frameRow(tS, scale), bytes: toBytes(toInt16(values, scale)) };
    },
  };
}

/** Sound as it is, but for everything outside the band. @param {number} rateHz @returns {Cutter} */
function wholeCutter(rateHz) {
  const { reach, apply } = makeBandFilter(rateHz);
  const lead = Math.round(BASEBAND.leadS * rateHz);
  const length = Math.round(FRAME_S * rateHz);
  /** @param {number} direct */
  const index = (direct) => Math.max(direct - lead, 0);
  return {
    index,
    lastNeeded: (direct) => index(direct) + length + reach,
    cut: (stream, first) => {
      const tS = first / rateHz;
      const near = stream.slice(first - reach, first + length + reach);
      return { tS, row: frameRow(tS), bytes: toPcm(apply(near)) };
    },
  };
}

// Bytes of the files that hold sound. All numbers are little-endian.

/** @param {Float32Array} samples in [-1, 1] @returns {Uint8Array} 16 bits each */
export function toPcm(samples) {
  const bytes = new Uint8Array(2 * samples.length);
  const view = new DataView(bytes.buffer);
  samples.forEach((value, k) => {
    const step = Math.round(Math.max(-1, Math.min(1, value)) * 32767);
    view.setInt16(2 * k, step, true);
  });
  return bytes;
}

/** @param {Int16Array} values @returns {Uint8Array} */
function toBytes(values) {
  const bytes = new Uint8Array(2 * values.length);
  const view = new DataView(bytes.buffer);
  values.forEach((value, k) => view.setInt16(2 * k, value, true));
  return bytes;
}

/** The largest size that a WAV can claim: the file was streamed, and ends where it ends. */
const STREAMED = 0xffffffff;

/** @param {number} rateHz @returns {Uint8Array} header of a mono, 16-bit WAV of unknown length */
export function wavHeader(rateHz) {
  const bytes = new Uint8Array(44);
  const view = new DataView(bytes.buffer);
  /** @param {number} at @param {string} letters */
  const text = (at, letters) => bytes.set(new TextEncoder().encode(letters), at);
  text(0, "RIFF");
  view.setUint32(4, STREAMED, true);
  text(8, "WAVEfmt ");
  view.setUint32(16, 16, true);
  view.setUint16(20, 1, true);
  view.setUint16(22, 1, true);
  view.setUint32(24, rateHz, true);
  view.setUint32(28, 2 * rateHz, true);
  view.setUint16(32, 2, true);
  view.setUint16(34, 16, true);
  text(36, "data");
  view.setUint32(40, STREAMED, true);
  return bytes;
}

/**
 * A frame's row in its table.
 * @param {number} tS @param {number} [scale] what one step of its 16 bits stands for
 */
function frameRow(tS, scale) {
  const columns = scale === undefined ? [] : [String(scale)];
  return `${[tS.toFixed(9), ...columns].join(",")}\n`;
}

/** First line of the table of frames, by what is kept. */
export const FRAME_HEADERS = { baseband: "t_s,scale\n", whole: "t_s\n" };

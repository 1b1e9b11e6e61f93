/** From the stream to frames: finds the direct arrival of every chirp and cuts what is kept of it. */

import { ECHO_PARAMETERS } from "../stages/constants.js";
import { makeScheduleSearch } from "../stages/echo_arrivals.js";
import { earliest, makeEnvelope, makeMatchedFilter, median, strongest } from "../stages/matched_filter.js";
import { makeStream } from "../stages/resample.js";
import { BASEBAND, makeBandFilter, makeBaseband, scaleOf, toInt16 } from "./baseband.js";

const FRAME_S = 0.08;

/**
 * @typedef {"baseband" | "whole"} Kind how the chirp band is kept: as I and Q, or as sound
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

// The direct arrival in every frame, followed from chirp to chirp by the rules of elfslam.stages.echo:
// near where it is due; anywhere in the period where it is not; a jump is noted.

/** After so many frames without a chirp its typical level is learnt anew. */
export const PATIENCE = 10;
const REMEMBERED = 15;

/**
 * Where the search stands. `due` is where the next direct arrival is expected, null before the first.
 * @typedef {{due: number | null, peaks: number[], missed: number}} Search
 * @typedef {{sample: number, isFound: boolean, jumped: number, peak: number, played?: number}} Arrival
 *   played: where that was told
 * @typedef {{search: Search, arrival: Arrival | null}} Step
 */

/** @type {Search} */
export const NOTHING_YET = { due: null, peaks: [], missed: 0 };

/**
 * Which stretch of envelope the next step needs, as [first, last + 1).
 * @param {Search} search @param {number} period samples @param {number} from sample to begin with
 * @returns {[number, number]}
 */
export function wantedStretch(search, period, from) {
  if (search.due === null) return [from, from + period];
  const half = period >> 1;
  return [Math.max(search.due - half, 0), search.due + half];
}

/**
 * One step: the next arrival in an envelope that begins at sample `first`. Before anything was found a
 * stretch without a chirp gives null.
 * @param {Search} search @param {Float32Array} envelope @param {number} first
 * @param {number} period samples @param {number} rateHz
 * @returns {Step}
 */
export function nextArrival(search, envelope, first, period, rateHz) {
  const early = Math.round(ECHO_PARAMETERS.early_s * rateHz);
  const level = leastLevel(search, envelope);
  if (search.due === null) return firstArrival(envelope, first, period, early, level);
  const slack = Math.round(ECHO_PARAMETERS.slack_s * rateHz);
  const due = search.due - first;
  let peak = strongest(envelope, due - slack, due + slack + 1);
  const isDue = envelope[peak] >= level;
  if (!isDue) peak = strongest(envelope);
  if (!(envelope[peak] >= level)) return missing(/** @type {Search & {due: number}} */ (search), period);
  const direct = first + earliest(envelope, peak, early, ECHO_PARAMETERS.early_share);
  const jumped = isDue ? 0 : direct - search.due;
  return found(search, direct, jumped, envelope[peak], period);
}

/** @param {Search} search @param {Float32Array} envelope */
function leastLevel(search, envelope) {
  const isForgotten = search.peaks.length === 0 || search.missed >= PATIENCE;
  if (isForgotten) return ECHO_PARAMETERS.contrast * Math.max(median(envelope), 1e-9);
  return ECHO_PARAMETERS.level_share * median(search.peaks);
}

/**
 * @param {Float32Array} envelope @param {number} first @param {number} period
 * @param {number} early @param {number} level
 * @returns {Step}
 */
function firstArrival(envelope, first, period, early, level) {
  const peak = strongest(envelope);
  if (!(envelope[peak] >= level)) return { search: NOTHING_YET, arrival: null };
  const direct = first + earliest(envelope, peak, early, ECHO_PARAMETERS.early_share);
  return found(NOTHING_YET, direct, 0, envelope[peak], period);
}

/**
 * @param {Search} search @param {number} sample @param {number} jumped
 * @param {number} peak @param {number} period
 * @returns {Step}
 */
function found(search, sample, jumped, peak, period) {
  const peaks = search.missed >= PATIENCE ? [] : search.peaks;
  return {
    search: { due: sample + period, peaks: [...peaks, peak].slice(-REMEMBERED), missed: 0 },
    arrival: { sample, isFound: true, jumped, peak },
  };
}

/**
 * Where no chirp is heard the frame is kept all the same, at the time when it was due.
 * @param {Search & {due: number}} search @param {number} period
 * @returns {Step}
 */
function missing(search, period) {
  return {
    search: { ...search, due: search.due + period, missed: search.missed + 1 },
    arrival: { sample: search.due, isFound: false, jumped: 0, peak: 0 },
  };
}

// The direct arrivals of chirps of which it is told when they were played, at the microphone's own rate.

/** Of the envelope so much is remembered for whoever listens to others. */
const HEARD_S = 4;

/**
 * @typedef {Arrival & {played: number}} ScheduledArrival
 * @typedef {import("../stages/echo_arrivals.js").Scheduled} Scheduled
 */

/**
 * `push` takes the next samples and gives the arrivals that they settle, in their order; `played` tells
 * when a chirp is played, before it is heard; `needs` gives the first sample that may still become one.
 * @param {{rateHz: number, chirp: Float32Array, period: number, guess: number, origin?: number}} given guess:
 *   samples from playing to hearing, as long as nothing is heard; origin: the sample at which the stream begins
 * @returns {{push: (samples: Float32Array) => ScheduledArrival[], played: (sample: number) => void,
 *   hasBegun: () => boolean, needs: () => number, heard: import("../stages/hearing.js").HeardSound}}
 */
export function makeScheduled({ rateHz, chirp, period, guess, origin = 0 }) {
  const envelopeOf = makeEnvelope(chirp);
  const envelope = makeStream(HEARD_S * rateHz, origin);
  /** @type {import("../stages/echo_arrivals.js").ScheduleSearch | null} */
  let search = null;
  let hasHeard = false;

  /** @param {number} sample */
  const played = (sample) => {
    if (search) search.played(sample);
    else search = makeScheduleSearch(sample, period, ECHO_PARAMETERS, { rateHz, guess });
  };

  /** Chirps that were played before any was heard went somewhere else. @param {Scheduled} arrival */
  const isKept = ({ sample, isFound }) => {
    hasHeard ||= isFound;
    return hasHeard && sample >= origin;
  };

  /** @param {Float32Array} samples */
  const push = (samples) => {
    envelope.append(envelope.end(), envelopeOf.push(samples));
    /** @type {Scheduled[]} */
    const arrivals = [];
    for (
      let more = /** @type {Scheduled[] | null | undefined} */ ([]);
      more;
      more = search?.next(envelope, false)
    ) arrivals.push(...more.filter(isKept));
    const needed = Math.min(search?.needs() ?? Infinity, envelope.end() - HEARD_S * rateHz);
    envelope.forget(needed - 2 * period);
    return arrivals.map(({ level, isFound, ...arrival }) => ({ ...arrival, isFound, peak: isFound ? level : 0 }));
  };

  /** @type {import("../stages/hearing.js").HeardSound} */
  const heard = {
    envelope: envelope.slice,
    end: envelope.end,
    late: (sample) => (search ? search.late(sample) : guess),
  };
  return { push, played, heard, hasBegun: () => search !== null, needs: () => search?.needs() ?? 0 };
}

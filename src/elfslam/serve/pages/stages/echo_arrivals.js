/**
 * The direct arrival in every frame, by the decisions of elfslam.stages.echo, made as the sound comes in:
 * near where it is due; anywhere in the period where it is not; an earlier peak of enough strength counts.
 *
 * What differs from Python: how loud an arrival typically is Python takes from the whole recording, this
 * from the frames of the last seconds. A recording without chirps is refused there; here nothing is found
 * until frames have them.
 */

import { ECHO_RATE_HZ } from "./constants.js";
import { earliest, median, strongest } from "./matched_filter.js";

/** Frames of which the typical level is known: five seconds, after which another volume is the usual one. */
const REMEMBERED = 50;

/**
 * @typedef {import("./resample.js").Stream} Stream
 * @typedef {{slack_s: number, early_s: number, latest_s: number, early_share: number, level_share: number,
 *   contrast: number}} EchoParameters the group `echo`
 * @typedef {{sample: number, due: number, level: number, jumped: number, isFound: boolean, played?: number}} Arrival at
 *   44.1 kHz; sample: of the direct arrival, or of what is loudest where it was due; level: of the envelope
 *   there; jumped: samples that it came off its time, 0 where it came as due; played: when, where that
 *   was told
 * @typedef {{next: (envelope: Stream, isOver: boolean) => Arrival[] | null,
 *   needs: () => number}} Search next: what has become of the next chirps, null where the envelope does
 *   not reach yet; needs: the first sample of the envelope that may still be asked for
 */

/**
 * @param {number} period samples
 * @param {EchoParameters} parameters
 * @returns {Search & {due: () => number | null}} due: where the next chirp is looked for, once it is known
 */
export function makePeriodSearch(period, parameters) {
  const slack = slackOf(parameters);
  const half = period >> 1;
  const directIn = makeDirect(parameters);
  const levelBefore = makeLevel(period, parameters);
  /** @type {number | null} */
  let due = null;
  let hasFound = false;

  /** @param {Stream} envelope @param {boolean} isOver */
  const begin = (envelope, isOver) => {
    if (envelope.end() < period && !isOver) return false;
    due ??= strongestIn(envelope, 0, period).sample;
    return true;
  };

  /** @param {Stream} envelope @param {boolean} isOver */
  const next = (envelope, isOver) => {
    if (due === null && !begin(envelope, isOver)) return null;
    const reaches = (/** @type {number} */ to) => isOver || envelope.end() >= to;
    const at = /** @type {number} */ (due);
    if (!reaches(at + slack + 1) || at >= envelope.end()) return null;
    const isKnown = levelBefore(envelope, at - slack) < Infinity;
    if (!isKnown && !reaches(at + period)) return null;
    const level = levelBefore(envelope, isKnown ? at - slack : at + period);
    const near = strongestIn(envelope, at - slack, at + slack + 1);
    if (near.value >= level) return found(envelope, near, 0);
    if (!reaches(at + half)) return null;
    const peak = strongestIn(envelope, at - half, at + half);
    return peak.value >= level ? found(envelope, peak, 1) : missed(envelope, at);
  };

  /**
   * `off`: 1 where the chirp did not come where it was due.
   * @param {Stream} envelope @param {{sample: number}} peak @param {number} off @returns {Arrival[]}
   */
  const found = (envelope, peak, off) => {
    const { sample, level } = directIn(envelope, peak);
    const arrival = { sample, due: hasFound ? /** @type {number} */ (due) : sample, level, isFound: true };
    const jumped = off * (sample - arrival.due);
    hasFound = true;
    due = sample + period;
    return [{ ...arrival, jumped }];
  };

  /** @param {Stream} envelope @param {number} at */
  const missed = (envelope, at) => {
    const arrivals = hasFound ? [missedAt(envelope, at, slack)] : [];
    due = at + period;
    return arrivals;
  };

  return { next, needs: () => (due ?? 0) - 2 * period, due: () => due };
}

/** @param {EchoParameters} parameters @returns {number} samples that a direct arrival may be off its time */
export function slackOf(parameters, rateHz = ECHO_RATE_HZ) {
  return Math.round(parameters.slack_s * rateHz);
}

/** A chirp that was not heard. @param {Stream} envelope @param {number} due @param {number} slack @returns {Arrival} */
export function missedAt(envelope, due, slack) {
  const isInside = due >= slack && due < envelope.end() - slack;
  const peak = isInside ? strongestIn(envelope, due - slack, due + slack + 1) : { sample: due, value: 0 };
  return { sample: peak.sample, due, level: peak.value, jumped: 0, isFound: false };
}

/**
 * The greatest value from sample `from` to `to`, without the last.
 * @param {Stream} envelope @param {number} from @param {number} to
 */
export function strongestIn(envelope, from, to) {
  const first = Math.max(from, 0);
  const values = envelope.slice(first, Math.max(Math.min(to, envelope.end()), first + 1));
  const best = strongest(values);
  return { sample: first + best, value: values[best] };
}

/**
 * What finds the direct arrival at or a little before a peak: an echo may be louder.
 * @param {EchoParameters} parameters
 * @returns {(envelope: Stream, peak: {sample: number}) => {sample: number, level: number}}
 */
export function makeDirect(parameters, rateHz = ECHO_RATE_HZ) {
  const early = Math.round(parameters.early_s * rateHz);
  return (envelope, peak) => {
    const first = Math.max(peak.sample - early - 1, 0);
    const values = envelope.slice(first, peak.sample + 1);
    const direct = earliest(values, peak.sample - first, early, parameters.early_share);
    return { sample: first + direct, level: values[direct] };
  };
}

/**
 * The least level of an arrival, from the loudest of each frame that is over by a sample, and at least
 * from the first; sound before sample `from` does not count. Frames that do not stand out
 * of their own noise do not count; Infinity without any.
 * @param {number} period @param {EchoParameters} parameters
 * @returns {(envelope: Stream, sample: number) => number}
 */
export function makeLevel(period, parameters, from = 0) {
  let counted = Math.floor(from / period);
  /** @type {number[]} */
  let peaks = [];
  const count = (/** @type {Stream} */ envelope) => {
    const frame = envelope.slice(counted * period, (counted + 1) * period).sort();
    const [floor, peak] = [frame[period >> 1], frame[period - 1]];
    if (peak >= parameters.contrast * Math.max(floor, 1e-9)) peaks = [...peaks, peak].slice(-REMEMBERED);
    counted += 1;
  };
  return (envelope, sample) => {
    const frames = Math.floor(Math.min(sample, envelope.end()) / period);
    while (counted < Math.max(frames, 1)) count(envelope);
    return peaks.length > 0 ? parameters.level_share * median(peaks) : Infinity;
  };
}

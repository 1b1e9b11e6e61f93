/**
 * The direct arrival in every frame, followed from chirp to chirp by the rules of elfslam.stages.echo:
 * near where it is due; anywhere in the period where it is not; a jump is noted.
 */

import { earliest, median, strongest } from "../stages/matched_filter.js";

export const RULES = {
  /** Direct arrival over the median envelope, at the least. */
  contrast: 8,
  /** Direct arrival over its typical level, at the least. */
  levelShare: 0.35,
  /** An earlier peak this strong is the direct one. */
  earlyShare: 0.5,
  earlyS: 0.0015,
  /** Jitter between frames. */
  slackS: 0.002,
  /** After so many frames without a chirp its typical level is learnt anew. */
  patience: 10,
};
const REMEMBERED = 15;

/**
 * Where the search stands. `due` is where the next direct arrival is expected, null before the first.
 * @typedef {{due: number | null, peaks: number[], missed: number}} Search
 * @typedef {{sample: number, isFound: boolean, jumped: number, peak: number}} Arrival
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
  const early = Math.round(RULES.earlyS * rateHz);
  const level = leastLevel(search, envelope);
  if (search.due === null) return firstArrival(envelope, first, period, early, level);
  const slack = Math.round(RULES.slackS * rateHz);
  const due = search.due - first;
  let peak = strongest(envelope, due - slack, due + slack + 1);
  const isDue = envelope[peak] >= level;
  if (!isDue) peak = strongest(envelope);
  if (!(envelope[peak] >= level)) return missing(/** @type {Search & {due: number}} */ (search), period);
  const direct = first + earliest(envelope, peak, early, RULES.earlyShare);
  const jumped = isDue ? 0 : direct - search.due;
  return found(search, direct, jumped, envelope[peak], period);
}

/** @param {Search} search @param {Float32Array} envelope */
function leastLevel(search, envelope) {
  const isForgotten = search.peaks.length === 0 || search.missed >= RULES.patience;
  if (isForgotten) return RULES.contrast * Math.max(median(envelope), 1e-9);
  return RULES.levelShare * median(search.peaks);
}

/**
 * @param {Float32Array} envelope @param {number} first @param {number} period
 * @param {number} early @param {number} level
 * @returns {Step}
 */
function firstArrival(envelope, first, period, early, level) {
  const peak = strongest(envelope);
  if (!(envelope[peak] >= level)) return { search: NOTHING_YET, arrival: null };
  const direct = first + earliest(envelope, peak, early, RULES.earlyShare);
  return found(NOTHING_YET, direct, 0, envelope[peak], period);
}

/**
 * @param {Search} search @param {number} sample @param {number} jumped
 * @param {number} peak @param {number} period
 * @returns {Step}
 */
function found(search, sample, jumped, peak, period) {
  const peaks = search.missed >= RULES.patience ? [] : search.peaks;
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

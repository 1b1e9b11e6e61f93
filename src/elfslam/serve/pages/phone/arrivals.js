/**
 * The direct arrival in every frame, followed from chirp to chirp by the rules of elfslam.stages.echo:
 * near where it is due; anywhere in the period where it is not; a jump is noted.
 */

import { ECHO_PARAMETERS } from "../stages/constants.js";
import { makeScheduleSearch } from "../stages/echo_schedule.js";
import { earliest, makeEnvelope, median, strongest } from "../stages/matched_filter.js";
import { makeStream } from "../stages/resample.js";

/** After so many frames without a chirp its typical level is learnt anew. */
export const PATIENCE = 10;
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
 * @typedef {import("../stages/echo_schedule.js").Scheduled} Scheduled
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
  /** @type {import("../stages/echo_schedule.js").ScheduleSearch | null} */
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

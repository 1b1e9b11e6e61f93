/**
 * The direct arrivals of chirps of which it is known when they were played: sound takes its time through
 * the phone, the same for all chirps until something jumps. The rules of elfslam.line.echo's schedule.
 */

import { RULES } from "./arrivals.js";
import { earliest, median, strongest } from "./matched_filter.js";

/** So long a stretch tells how late chirps arrive, which is at most `latestS`. */
export const STRETCH = { seconds: 2, latestS: 1 };
/** So many more chirps missed than found, and the time from playing to hearing is searched anew. */
export const PATIENCE = 8;
/** Where the time is wrong one chirp in five is found by chance. */
const FOUND_AGAINST_MISSED = 2;
const RECENT = 5;
const REMEMBERED = 15;
/** The earliest of nearly equals: a regular schedule fits whole periods later as well. */
const ABOUT_AS_CLEAR = 0.95;

/**
 * late: samples from playing to hearing, null where nothing is known of it.
 * @typedef {{late: number | null, recent: number[], peaks: number[], missed: number}} Lateness
 */

/** @param {number | null} late @returns {Lateness} */
export function lateBy(late) {
  return { late, recent: [], peaks: [], missed: 0 };
}

/**
 * How late chirps arrive that were played at these samples; null where the sound does not say so.
 * @param {Float32Array} envelope beginning at sample `first`
 * @param {number} first @param {number[]} played @param {number} rateHz
 * @returns {number | null}
 */
export function findLate(envelope, first, played, rateHz) {
  const slack = Math.round(RULES.slackS * rateHz);
  const total = new Float64Array(Math.round(STRETCH.latestS * rateHz));
  for (const start of played) {
    for (let d = 0; d < total.length; d += 1) total[d] += Math.sqrt(envelope[start + d - first] ?? 0);
  }
  const least = ABOUT_AS_CLEAR * total[strongest(total)];
  const late = total.findIndex((value) => value >= least);
  const dues = played.map((start) => start + late - first);
  const peaks = dues.map((due) => strongest(envelope, due - slack, due + slack + 1));
  const level = median(peaks.map((peak) => envelope[peak]));
  if (!(level >= RULES.contrast * Math.max(median(envelope), 1e-9))) return null;
  return late + Math.round(median(peaks.map((peak, k) => peak - dues[k])));
}

/**
 * The arrival of the chirp that was played at sample `played`, in an envelope that begins at `first`.
 * @param {Lateness} lateness @param {Float32Array} envelope @param {number} first
 * @param {number} played @param {number} rateHz
 * @returns {{lateness: Lateness, arrival: import("./arrivals.js").Arrival & {played: number}}}
 */
export function scheduledArrival(lateness, envelope, first, played, rateHz) {
  const slack = Math.round(RULES.slackS * rateHz);
  const due = played + lateness.late - first;
  const peak = strongest(envelope, due - slack, due + slack + 1);
  if (!(envelope[peak] >= leastLevel(lateness, envelope))) {
    const arrival = { sample: due + first, isFound: false, jumped: 0, peak: 0, played };
    return { lateness: { ...lateness, missed: lateness.missed + 1 }, arrival };
  }
  const early = Math.round(RULES.earlyS * rateHz);
  const sample = first + earliest(envelope, peak, early, RULES.earlyShare);
  const recent = [...lateness.recent, sample - played].slice(-RECENT);
  const peaks = [...lateness.peaks, envelope[peak]].slice(-REMEMBERED);
  const missed = Math.max(lateness.missed - FOUND_AGAINST_MISSED, 0);
  const next = { late: Math.round(median(recent)), recent, peaks, missed };
  return { lateness: next, arrival: { sample, isFound: true, jumped: 0, peak: envelope[peak], played } };
}

function leastLevel({ peaks }, envelope) {
  if (peaks.length === 0) return RULES.contrast * Math.max(median(envelope), 1e-9);
  return RULES.levelShare * median(peaks);
}

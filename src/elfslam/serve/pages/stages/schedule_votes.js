/** How late chirps are heard, told by the sound itself: the time on which most of them agree. Pure. */

import { median } from "../phone/matched_filter.js";

/**
 * late: samples from playing to hearing; hits: chirps that are heard so late; due: those that should be.
 * @typedef {{late: number, hits: number, due: number}} Vote
 */

/**
 * Where something is loud: peaks of an envelope that begins at sample `first`, none near a greater one.
 * @param {Float32Array} envelope @param {number} first @param {number} level the least that counts
 * @param {number} apart samples within which only the greatest counts
 * @returns {number[]} samples
 */
export function peaksOf(envelope, first, level, apart) {
  const peaks = [];
  for (let k = 0; k < envelope.length; k += 1) {
    if (!(envelope[k] >= level)) continue;
    const last = peaks.at(-1);
    if (last === undefined || k - last > apart) peaks.push(k);
    else if (envelope[k] > envelope[last]) peaks[peaks.length - 1] = k;
  }
  return peaks.map((k) => first + k);
}

/**
 * A vote for every time by which some peak may be one of the chirps.
 * @param {number[]} played samples at which chirps were played, in their order
 * @param {number[]} peaks samples, in their order
 * @param {{until: number, latest: number, alike: number}} given until: what is due there was not heard yet;
 *   latest: the longest that sound takes; alike: times within this of each other are the same
 * @returns {Vote[]}
 */
export function votesOf(played, peaks, { until, latest, alike }) {
  const times = played.flatMap((start) => peaks.map((peak) => peak - start));
  const possible = [...new Set(times)].filter((time) => time >= 0 && time <= latest);
  return possible.map((time) => {
    const found = played.map((start) => differenceTo(start + time, peaks, alike)).filter((off) => off !== null);
    const due = played.filter((start) => start + time < until).length;
    return { late: time + Math.round(median(found)), hits: found.length, due: Math.max(due, found.length) };
  });
}

/**
 * From a sample to the peak nearest to it; null where none is near.
 * @param {number} sample @param {number[]} peaks @param {number} alike
 */
function differenceTo(sample, peaks, alike) {
  let best = null;
  for (const peak of peaks) {
    const off = peak - sample;
    if (Math.abs(off) <= alike && (best === null || Math.abs(off) < Math.abs(best))) best = off;
  }
  return best;
}

/** Chirps heard beyond those that should have been and were not. @param {Vote} vote */
export function leadOf({ hits, due }) {
  return 2 * hits - due;
}

/**
 * The vote with the greatest worth, the nearest to `late` among equals.
 * @param {Vote[]} votes @param {(vote: Vote) => number} worth @param {number} late
 * @returns {Vote | null}
 */
export function bestOf(votes, worth, late) {
  /** @param {Vote} a @param {Vote} b */
  const before = (a, b) => worth(b) - worth(a) || Math.abs(a.late - late) - Math.abs(b.late - late);
  return votes.reduce(
    (best, vote) => (best === null || before(vote, best) < 0 ? vote : best), /** @type {Vote | null} */ (null),
  );
}

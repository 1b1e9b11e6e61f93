/** How long sound takes from playing to hearing, by when chirps were played and when they were heard. Pure. */

import { median } from "../matched_filter.js";

/** Sound servers keep sound back, but not for so long. */
const LONGEST_S = 1.2;
/** Arrivals within this of each other took equally long. */
const ALIKE_S = 0.001;
/** So many arrivals tell how long it takes by now. */
const RECENT = 12;
const FEWEST = 4;

/**
 * The time that most arrivals agree on. Where several do as well, as when chirps come evenly, the one
 * nearest to `before`, else the longest: the first chirp heard is then the first that was played.
 * @param {number[]} heardS @param {number[]} playedS @param {number | null} before
 * @returns {number | null} null where too few agree
 */
export function latenessOf(heardS, playedS, before = null) {
  const times = heardS.flatMap((heard) => playedS.map((played) => heard - played));
  const possible = times.filter((time) => time >= 0 && time <= LONGEST_S).sort((a, b) => a - b);
  const groups = possible.map((from, k) => possible.slice(k).filter((time) => time - from <= ALIKE_S));
  const most = Math.max(0, ...groups.map((group) => group.length));
  if (most < FEWEST) return null;
  const candidates = groups.filter((group) => group.length === most).map(median);
  if (before === null) return candidates[candidates.length - 1];
  return candidates.reduce((best, time) => (Math.abs(time - before) < Math.abs(best - before) ? time : best));
}

/** @returns {{played: (tS: number) => void, heard: (tS: number) => void, latenessS: () => number | null}} */
export function followLateness() {
  let playedS = [];
  let heardS = [];
  let lateness = null;
  return {
    played: (tS) => playedS.push(tS),
    heard(tS) {
      heardS = [...heardS, tS].slice(-RECENT);
      playedS = playedS.filter((time) => time >= heardS[0] - LONGEST_S);
      lateness = latenessOf(heardS, playedS, lateness) ?? lateness;
    },
    latenessS: () => lateness,
  };
}

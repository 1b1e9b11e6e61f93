/** Fixes and echoes as they come, told by the view. */

import { showPlaceFacts, showWords, speak } from "./place_view.js";
import { withFix } from "./trail.js";
import { WAITING, wordsOf } from "./words.js";

/** A status that lasts so long is worth saying aloud. */
const SPEAK_AFTER_MS = 1500;
const CLOCK_MS = 500;

/**
 * @typedef {import("./words.js").Fix} Fix
 * @typedef {(heardS: number) => number} PlayedUntil how many chirps should have been heard
 */

/**
 * @param {import("./locating.js").Here} here @param {"track" | "one-shot"} mode
 * @returns {{told: {fix: (fix: Fix) => void, echo: (echo: {tS: number}) => void},
 *   begin: (playedUntil: PlayedUntil) => void, end: () => void, fixes: () => Fix[]}}
 */
export function showFixes(here, mode) {
  /** @type {Fix[]} */
  const fixes = [];
  const echoes = { count: 0, lastS: NaN };
  const speaker = makeSpeaker(WAITING[mode]);
  let timer = 0;

  /** @param {Fix} found */
  const fix = (found) => {
    fixes.push(found);
    here.trail = withFix(here.trail, found);
    here.map?.setTrail(here.trail);
    showWords(wordsOf(found));
    speaker.consider(wordsOf(found));
  };
  /** @param {{tS: number}} echo */
  const echo = ({ tS }) => {
    echoes.lastS = tS;
    echoes.count += 1;
  };
  /** @param {PlayedUntil} playedUntil */
  const begin = (playedUntil) => {
    const beganMs = performance.now();
    const show = () => showPlaceFacts({
      seconds: (performance.now() - beganMs) / 1000,
      fixes: here.trail.count,
      heardShare: heardShare(echoes, playedUntil),
    });
    show();
    timer = setInterval(show, CLOCK_MS);
  };
  const end = () => {
    clearInterval(timer);
    speaker.hush();
  };
  return { told: { fix, echo }, begin, end, fixes: () => fixes };
}

/**
 * Of the chirps that were played until the last that was heard.
 * @param {{count: number, lastS: number}} echoes @param {PlayedUntil} playedUntil
 */
function heardShare({ count, lastS }, playedUntil) {
  return count === 0 ? null : Math.min(count / Math.max(playedUntil(lastS), 1), 1);
}

/** Says aloud what has become different and stays so. @param {import("./words.js").Words} first */
function makeSpeaker(first) {
  let said = first.verdict;
  let timer = 0;
  /** @param {import("./words.js").Words} words */
  const consider = (words) => {
    clearTimeout(timer);
    if (words.verdict === said) return;
    timer = setTimeout(() => {
      said = words.verdict;
      speak(words);
    }, SPEAK_AFTER_MS);
  };
  return { consider, hush: () => clearTimeout(timer) };
}

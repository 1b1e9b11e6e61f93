/** Whether what is heard can be the room's answer to the phone's own chirps: elfslam.stages.spoofing, live. */

import { SPOOFING } from "./constants.js";
import { marked } from "../shared/marked.js";
import { median } from "./matched_filter.js";

/** An echo belongs to the frame whose direct sound came then, within so many seconds. */
const SAME_S = 1e-3;
/** Clean echoes that wait for the frames they belong to, at the most. */
const MOST_WAITING = 1000;

/** By number; 0 is trusted. */
export const REASONS = [
  "",
  marked("the own chirp comes at another time than it was played"),
  marked("sound comes before its chirp"),
  marked("echoes are louder than a room returns them"),
  marked("there is noise in the band of the chirp"),
  marked("the microphone is driven to its limit"),
  marked("echoes do not follow the loudness of their chirps"),
];
const LAGGING = REASONS.length - 1;
/**
 * PARTS: of equal length, of an echo trace; SHARPENED: what the fourth difference makes of the middle of the band; RECENT:
 * chirps whose median says when a direct arrival is due; HISS: white noise in an echo trace (rms of fourth differences)
 * over that in the envelope (median); CALM: both limits of a lag are so much lower while SUSPECT.
 */
const { CALM, HISS, PARTS, RECENT, SHARPENED } = SPOOFING;

/**
 * @typedef {{dueS: number, lateS: number, level: number, before: number, noise: number, clipped: number,
 *   gainDb?: number}} Facts of one chirp, as echo_facts.js gives them; gainDb: how loud it was played, where
 *   that is known
 * @typedef {{dueS: number, odd: boolean[]}} Judged whether a frame is odd, for each reason but the first
 * @typedef {{dueS: number, gainDb: number, hissDb: number, partsDb: number[], arrivedS: number}} Chirp
 * @typedef {{compared_chirps?: number, lag?: number, lag_errors?: number, clear_db?: number}} FollowingParameters
 * @typedef {FollowingParameters & {memory_s: number, odd_share: number, calm_share: number,
 *   fewest_frames: number, off_time_s: number, before: number, noise: number, loud_first: number,
 *   loud_second: number, loud_third: number, loud_last: number, clipped: number}} SpoofingParameters
 */

/**
 * A judge of frames as they come. `take` is given the facts of frames and the echoes, each in their order and
 * an echo not after its frame; `reasonAt(endS)` gives the number of the reason to suspect what was heard up
 * to then, 0 where there is none, more strictly behind a suspect one; `REASONS` has it in words. The room's
 * echoes follow the loudness of their chirps, dB for dB; sound that somebody else plays does not. That is
 * asked of `clean` echoes alone, of those that others' chirps have not spoiled; they may come later.
 * @param {SpoofingParameters} parameters the group "spoofing"
 * @returns {{take: (facts: Facts[], echoes: {tS: number, samples: Float32Array}[],
 *   clean?: {tS: number}[]) => void,
 *   reasonAt: (endS: number) => number}}
 */
export function makeSpoofingCheck(parameters) {
  const names = /** @type {const} */ (["loud_first", "loud_second", "loud_third", "loud_last"]);
  const bounds = names.map((name) => parameters[name]);
  /** @type {{tS: number, rms: number[]}[]} */
  let loud = [];
  /** @type {number[]} */
  let recent = [];
  /** @type {Judged[]} */
  let frames = [];
  const following = makeFollowing(parameters);
  let last = 0;

  /**
   * @param {Facts[]} facts @param {{tS: number, samples: Float32Array}[]} echoes
   * @param {{tS: number}[]} clean
   */
  const take = (facts, echoes, clean = echoes) => {
    loud.push(...echoes.map(({ tS, samples }) => ({ tS, rms: loudnessOf(samples) })));
    following.addClean(clean.map(({ tS }) => tS));
    for (const each of facts) {
      const rms = loudnessOver(each);
      frames.push({ dueS: each.dueS, odd: oddIn(each, rms) });
      following.add(each, rms);
    }
  };

  /** @param {Facts} facts @param {number[]} rms */
  const oddIn = ({ lateS, level, before, noise, clipped }, rms) => {
    const off = offTime(lateS);
    const floor = Math.max(level, 1e-12);
    return [
      off > parameters.off_time_s,
      before > parameters.before,
      rms.some((value, part) => value > bounds[part]),
      noise / floor > parameters.noise,
      clipped > parameters.clipped,
    ];
  };

  /** @param {number} lateS */
  const offTime = (lateS) => {
    if (Number.isNaN(lateS)) return Infinity;
    const off = recent.length > 0 ? Math.abs(lateS - median(recent)) : 0;
    recent = [...recent, lateS].slice(-RECENT);
    return off;
  };

  /** Of each part of the echo trace over the direct level. @param {Facts} facts */
  const loudnessOver = ({ dueS, lateS, level }) => {
    const arrivedS = dueS + (Number.isNaN(lateS) ? 0 : lateS);
    loud = loud.filter(({ tS }) => tS >= arrivedS - SAME_S);
    const rms = loud.length > 0 && loud[0].tS <= arrivedS + SAME_S ? loud[0].rms : [0, 0, 0, 0];
    return rms.map((value) => value / Math.max(level, 1e-12));
  };

  /** @param {number} endS */
  const reasonAt = (endS) => {
    const seen = frames.filter(({ dueS }) => dueS >= endS - parameters.memory_s && dueS < endS);
    frames = frames.filter(({ dueS }) => dueS >= endS - parameters.memory_s);
    const lags = following.lagsAt(endS, last > 0);
    const reason = seen.length < parameters.fewest_frames ? 0 : reasonIn(seen);
    last = reason || (lags ? LAGGING : 0);
    return last;
  };

  /** @param {Judged[]} seen */
  const reasonIn = (seen) => {
    const limit = last > 0 ? parameters.calm_share : parameters.odd_share;
    const share = (/** @type {number} */ reason) => seen.filter(({ odd }) => odd[reason - 1]).length / seen.length;
    const ofFrames = REASONS.slice(0, LAGGING);
    return Math.max(ofFrames.findIndex((_, reason) => reason > 0 && share(reason) >= limit), 0);
  };
  return { take, reasonAt };
}

/**
 * Whether echoes follow the loudness of their chirps. Over the direct sound the room's are alike however loud
 * the chirp; what is added to them is over a soft one's the louder, and so is noise: parts of the trace near it
 * do not count. Maps that were made before there was this rule lack its parameters: then nothing is said.
 * @param {FollowingParameters} parameters
 * @returns {{add: (facts: Facts, rms: number[]) => void, addClean: (timesS: number[]) => void,
 *   lagsAt: (endS: number, wasSuspect: boolean) => boolean}} add: rms of each part of its echo trace over the
 *   direct level; addClean: when the direct sound of clean echoes came; lagsAt: by the last chirps before then
 */
function makeFollowing({ compared_chirps: count = Infinity, lag: least, lag_errors: errors, clear_db: clearDb }) {
  /** @type {[Chirp[], Chirp[], number[]]} */
  let [chirps, waiting, clean] = [[], [], []];

  /** @param {Facts} facts @param {number[]} rms */
  const add = ({ dueS, lateS, level, noise, gainDb }, rms) => {
    if (gainDb === undefined || count === Infinity || Number.isNaN(lateS) || rms.some((value) => value === 0)) return;
    const hissDb = decibels(Math.max((HISS * noise) / Math.max(level, 1e-12), 1e-12));
    waiting.push({ dueS, gainDb, hissDb, partsDb: rms.map(decibels), arrivedS: dueS + lateS });
    settle();
  };

  /** @param {number[]} timesS */
  const addClean = (timesS) => {
    clean = [...clean, ...timesS].slice(-MOST_WAITING);
    settle();
  };

  /** Chirps whose echoes are clean count; those that clean ones have overtaken do not. */
  const settle = () => {
    while (waiting.length > 0 && clean.length > 0) {
      const behindS = waiting[0].arrivedS - clean[0];
      if (Math.abs(behindS) <= SAME_S) chirps.push(waiting[0]);
      if (behindS <= SAME_S) waiting.shift();
      if (behindS >= -SAME_S) clean.shift();
    }
  };

  /** @param {number} endS @param {boolean} wasSuspect */
  const lagsAt = (endS, wasSuspect) => {
    const first = chirps.findIndex(({ dueS }) => dueS >= endS);
    const last = first < 0 ? chirps.length : first;
    if (last <= count) return false;
    chirps = chirps.slice(last - count - 1);
    const { lag, error } = lagOf(chirps.slice(0, count + 1), /** @type {number} */ (clearDb));
    const limit = Math.max(/** @type {number} */ (least), /** @type {number} */ (errors) * error);
    return lag >= (wasSuspect ? CALM * limit : limit);
  };
  return { add, addClean, lagsAt };
}

/**
 * dB per dB of their chirps that echoes lack, and its standard error; NaN where nothing tells.
 * @param {Chirp[]} chirps @param {number} clearDb
 */
function lagOf(chirps, clearDb) {
  const over = (/** @type {number} */ part) => median(chirps.map(({ partsDb, hissDb }) => partsDb[part] - hissDb));
  const clear = chirps[0].partsDb.map((_, part) => part).filter((part) => over(part) >= clearDb);
  const played = changes(chirps.map(({ gainDb }) => gainDb));
  const echoes = changes(chirps.map(({ partsDb }) => sum(clear.map((part) => partsDb[part])) / clear.length));
  const spread = sum(played.map((value) => value ** 2));
  const lag = -sum(played.map((value, k) => value * echoes[k])) / spread;
  const rest = sum(echoes.map((value, k) => (value + lag * played[k]) ** 2)) / (echoes.length - 1);
  return { lag, error: Math.sqrt(rest / spread) };
}

/** @param {number[]} values */
function changes(values) {
  return values.slice(1).map((value, k) => value - values[k]);
}

/** @param {number} value */
function decibels(value) {
  return 20 * Math.log10(value);
}

/** @param {number[]} values */
function sum(values) {
  return values.reduce((total, value) => total + value, 0);
}

/**
 * Root mean square of each part of an echo trace, of its fourth differences: they leave little of what is
 * below the chirp's band.
 * @param {Float32Array} samples (2352) @returns {number[]} (4)
 */
export function loudnessOf(samples) {
  const size = samples.length / PARTS;
  const squares = new Array(PARTS).fill(0);
  for (let k = 4; k < samples.length; k += 1) {
    const sharp = samples[k] - 4 * samples[k - 1] + 6 * samples[k - 2] - 4 * samples[k - 3] + samples[k - 4];
    squares[Math.floor(k / size)] += sharp * sharp;
  }
  return squares.map((sum) => Math.sqrt(sum / size) / SHARPENED);
}

/** What else was heard around each chirp, as elfslam.stages.echo's frame_facts says it. */

import { ECHO_RATE_HZ } from "./resample.js";

/** From how long before a direct arrival to how long before it nothing should be heard. */
const QUIET = [Math.round(0.02 * ECHO_RATE_HZ), Math.round(0.002 * ECHO_RATE_HZ)];
/** Behind a direct arrival its echoes are over. */
const OVER = Math.round(0.065 * ECHO_RATE_HZ);
const FULL_SCALE = 0.999;

/**
 * @typedef {import("../phone/stream.js").Stream} Stream
 * @typedef {{sound: Stream, envelope: Stream}} Heard
 * @typedef {import("./echo_arrivals.js").Arrival & {gainDb?: number}} Played
 */

/**
 * Of the envelope of the matched filter: `level` of the direct sound, `before` the largest in the quiet
 * stretch before it over that, `noise` the typical there.
 * @typedef {{dueS: number, lateS: number, level: number, before: number, noise: number, clipped: number,
 *   gainDb?: number}} FrameFacts dueS: when its direct sound was due; lateS: how much later it came, NaN where
 *   it did not; clipped: share of samples at full scale; gainDb: how loud it was played, where that was told
 */

/**
 * Facts of chirps as they become complete, which is when their echoes are over.
 * @returns {{take: (arrivals: Played[], heard: Heard, isOver: boolean) => FrameFacts[], needs: () => number}}
 */
export function makeFacts() {
  /** @type {number | null} */
  let before = null;
  /** @type {Played[]} */
  const waiting = [];

  /** @param {Played[]} arrivals @param {Heard} heard @param {boolean} isOver */
  const take = (arrivals, heard, isOver) => {
    waiting.push(...arrivals);
    const facts = [];
    while (waiting.length > 0 && isComplete(heard.sound, isOver)) {
      const arrival = /** @type {Played} */ (waiting.shift());
      facts.push(factsOf(arrival, before, heard));
      before = arrival.sample;
    }
    return facts;
  };

  /** By then its echo is cut, which spoofing wants first. @param {Stream} sound @param {boolean} isOver */
  const isComplete = (sound, isOver) => isOver || sound.end() >= waiting[0].sample + OVER;

  return { take, needs: () => (waiting.length > 0 ? waiting[0].sample - QUIET[0] : Infinity) };
}

/**
 * @param {Played} arrival @param {number | null} before @param {Heard} heard
 * @returns {FrameFacts}
 */
function factsOf({ sample, due, level, isFound, gainDb }, before, { sound, envelope }) {
  const dueS = due / ECHO_RATE_HZ;
  const lateS = isFound ? (sample - due) / ECHO_RATE_HZ : NaN;
  const nothing = { dueS, lateS, level: 0, before: 0, noise: 0, clipped: 0, gainDb };
  if (sample < 0 || sample >= envelope.end()) return nothing;
  const begin = Math.max(sample - QUIET[0], before === null ? 0 : before + OVER, 0);
  const quiet = between(envelope, begin, sample - QUIET[1]);
  const frame = between(sound, sample, Math.min(sample + OVER, sound.end()));
  return {
    dueS,
    lateS,
    level,
    before: most(quiet) / Math.max(level, 1e-9),
    noise: middle(quiet),
    clipped: frame.filter((value) => Math.abs(value) >= FULL_SCALE).length / frame.length,
    gainDb,
  };
}

/** @param {Stream} stream @param {number} from @param {number} to */
function between(stream, from, to) {
  return stream.slice(from, Math.max(Math.min(to, stream.end()), from));
}

/** @param {Float32Array} values */
function most(values) {
  return values.reduce((highest, value) => Math.max(highest, value), 0);
}

/** @param {Float32Array} values */
function middle(values) {
  if (values.length === 0) return 0;
  const half = values.length >> 1;
  const sorted = values.sort();
  return values.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}

/**
 * Two clocks: events carry the page's (milliseconds), a recording runs on that of the sound (seconds).
 * Pairs of readings of both, taken again and again, tie them by a straight line.
 */

const CLOCK_EVERY_MS = 200;
/** Three seconds: where the browser's sound stalls, its clock falls behind, and is followed there. */
const CLOCK_PAIRS = 15;
const LIKELY_DRIFT = 1e-3;
const FEWEST = 3;

/**
 * @typedef {{pageMs: number, soundS: number}} Pair
 * @typedef {{originMs: number, originS: number, rate: number}} Line rate: sound seconds per page second
 */

/**
 * The line through the pairs by least squares. A rate further from 1 than clocks ever are is noise, and
 * 1 is taken then.
 * @param {Pair[]} pairs at least one
 * @returns {Line}
 */
export function fitClocks(pairs) {
  const originMs = mean(pairs.map((pair) => pair.pageMs));
  const originS = mean(pairs.map((pair) => pair.soundS));
  let above = 0;
  let below = 0;
  for (const { pageMs, soundS } of pairs) {
    const pageS = (pageMs - originMs) / 1000;
    above += pageS * (soundS - originS);
    below += pageS * pageS;
  }
  const slope = below > 0 ? above / below : 1;
  const isLikely = pairs.length >= FEWEST && Math.abs(slope - 1) <= LIKELY_DRIFT;
  return { originMs, originS, rate: isLikely ? slope : 1 };
}

/** @param {Line} line @param {number} pageMs @returns {number} seconds of the sound's clock */
export function soundTime(line, pageMs) {
  return line.originS + (line.rate * (pageMs - line.originMs)) / 1000;
}

/** A stall of the sound longer than this puts its clock behind for good: pairs of before mislead. */
const STALLED_S = 0.1;

/**
 * The latest pairs, at most so many; those of before a stall are left out.
 * @param {Pair[]} pairs @param {Pair} pair @param {number} most @returns {Pair[]}
 */
export function withPair(pairs, pair, most) {
  const last = pairs.at(-1);
  const offset = (/** @type {Pair} */ { pageMs, soundS }) => soundS - pageMs / 1000;
  if (last && Math.abs(offset(pair) - offset(last)) > STALLED_S) return [pair];
  return [...pairs, pair].slice(-most);
}

/**
 * What the audio context says of both clocks now: when, on the page's clock, which of its moments comes
 * out of the loudspeaker. Where it says nothing of use, now stands for now.
 * @param {{currentTime: number, outputLatency?: number,
 *   getOutputTimestamp?: () => {contextTime?: number, performanceTime?: number}}} context
 * @param {number} nowMs
 * @returns {Pair}
 */
export function readClocks(context, nowMs) {
  const { contextTime = 0, performanceTime = 0 } = context.getOutputTimestamp?.() ?? {};
  if (contextTime > 0 && performanceTime > 0) return { pageMs: performanceTime, soundS: contextTime };
  return { pageMs: nowMs, soundS: context.currentTime - (context.outputLatency ?? 0) };
}

/**
 * Reads both clocks again and again.
 * @param {AudioContext} context
 * @returns {{line: () => import("./clocks.js").Line, stop: () => void}}
 */
export function watchClocks(context) {
  let pairs = [readClocks(context, performance.now())];
  const timer = setInterval(() => {
    pairs = withPair(pairs, readClocks(context, performance.now()), CLOCK_PAIRS);
  }, CLOCK_EVERY_MS);
  return { line: () => fitClocks(pairs), stop: () => clearInterval(timer) };
}

/**
 * Some browsers stamp events on another clock than the page's; those are taken to happen now.
 * @param {number} stampMs @param {number} nowMs
 */
export function eventTime(stampMs, nowMs) {
  return Math.abs(nowMs - stampMs) < 1000 ? stampMs : nowMs;
}

/** @param {number[]} values */
function mean(values) {
  return values.reduce((sum, value) => sum + value, 0) / values.length;
}

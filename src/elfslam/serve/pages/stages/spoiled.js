/**
 * Frames into which other phones chirped, by the rules of elfslam.stages.medium_access: what is heard before a direct
 * arrival, where nothing of ours sounds, and what stands out over the same moment of the frames around.
 */

import { ECHO_RATE_HZ, FOREIGN } from "./constants.js";
import { makeHearing, pooled } from "./hearing.js";

/**
 * FRAME: bins behind a direct arrival in which its echoes are kept; QUIET: bins before it, another's chirp there still
 * sounds in its echoes; WIDER: bins by which an echo may move; FEWEST: frames before one can tell what is usual.
 */
const { BIN, DIRECT, FEWEST, FRAME, GUARD, LULL, QUIET, WIDER } = FOREIGN;
/** Frames further apart are too different to be compared. */
const NEAR = FOREIGN.NEAR_S * ECHO_RATE_HZ;

/**
 * @typedef {import("./echo.js").Echo} Echo
 * @typedef {import("./hearing.js").MediumAccessParameters} MediumAccessParameters
 */

/**
 * A frame as others' chirps are looked for in it.
 * @typedef {{sample: number, direct: number, bins: Float32Array, wide: Float32Array, isEarly: boolean}} Looked
 *   isEarly: another's chirp is heard before it
 */

/** Up to which sample the envelope must reach before a frame can be looked at. @param {number} sample */
function reachOf(sample) {
  return sample + FRAME * BIN;
}

/**
 * @param {(from: number, to: number) => Float32Array} envelope at 44.1 kHz
 * @param {number} sample of the direct arrival @param {number | null} last that of the frame before
 * @param {MediumAccessParameters} parameters
 * @returns {Looked}
 */
export function lookAt(envelope, sample, last, parameters) {
  /** @param {number} from @param {number} count */
  const binsFrom = (from, count) => pooled(envelope(from, from + Math.max(count, 0) * BIN), 0, count);
  const direct = envelope(sample, sample + 1)[0];
  const bins = binsFrom(sample + DIRECT * BIN, FRAME - DIRECT);
  const begin = Math.max(sample - QUIET * BIN, (last ?? sample - 10 * LULL * BIN) + LULL * BIN);
  const quiet = binsFrom(begin, Math.floor((sample - begin) / BIN) - GUARD);
  const least = Math.fround(parameters.share * direct);
  return { sample, direct, bins, wide: widened(bins), isEarly: quiet.some((value) => value > least) };
}

/**
 * Whether a frame is spoiled, by the frames before and behind it that are close in time.
 * @param {Looked[]} before in their order @param {Looked} frame @param {Looked[]} behind in their order
 * @param {MediumAccessParameters} parameters
 */
export function isSpoiled(before, frame, behind, parameters) {
  const around = [...before.slice(-parameters.frames), ...behind.slice(0, parameters.frames)];
  const near = around.filter(({ sample }) => Math.abs(sample - frame.sample) < NEAR);
  return frame.isEarly || (near.length >= FEWEST && standsOut(frame, near, parameters));
}

/** @param {Looked} frame @param {Looked[]} near @param {MediumAccessParameters} parameters */
function standsOut({ bins, direct }, near, { contrast, share }) {
  const least = Math.fround(share * direct);
  /** @param {number} k */
  const usual = (k) => middle(near.map(({ wide }) => wide[k]));
  return bins.some((value, k) => value > least && value > Math.fround(contrast * usual(k)));
}

/** The largest of the bins around each: what may be heard there in the next frame. @param {Float32Array} bins */
function widened(bins) {
  return bins.map((_, k) => bins.subarray(Math.max(k - WIDER, 0), k + WIDER + 1).reduce((a, b) => Math.max(a, b), 0));
}

/** @param {number[]} values */
function middle(values) {
  const sorted = values.sort((a, b) => a - b);
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : Math.fround((sorted[half - 1] + sorted[half]) / 2);
}

/**
 * Keeps back spoiled echoes as they come. While others are about an echo waits for those behind it that tell
 * what is usual, or until none can come any more; else it goes on at once.
 * @param {import("./hearing.js").HeardSound & {sampleAt: (tS: number) => number}} heard
 * @param {MediumAccessParameters} parameters
 * @returns {{take: (echoes: Echo[], isAmongOthers: boolean) => Echo[]}}
 */
export function makeSpoiled(heard, parameters) {
  /** @type {Looked[]} */
  let past = [];
  /** @type {{echo: Echo, looked: Looked | null, isOut: boolean}[]} */
  let frames = [];

  const look = () => {
    let last = past.at(-1);
    for (const frame of frames) {
      const sample = heard.sampleAt(frame.echo.tS);
      if (!frame.looked && heard.end() < reachOf(sample)) return;
      frame.looked ??= lookAt(heard.envelope, sample, last?.sample ?? null, parameters);
      last = frame.looked;
    }
  };

  const behind = () => frames.slice(1).flatMap(({ looked }) => looked ?? []);

  /** @param {typeof frames} frames */
  const isReady = ([frame]) =>
    frame?.looked && (behind().length >= parameters.frames || heard.end() > reachOf(frame.looked.sample) + NEAR);

  /** @param {Echo[]} echoes @param {boolean} isAmongOthers */
  const take = (echoes, isAmongOthers) => {
    frames.push(...echoes.map((echo) => ({ echo, looked: null, isOut: false })));
    look();
    const clean = [];
    while (isReady(frames)) {
      const { echo, looked, isOut } = /** @type {{echo: Echo, looked: Looked, isOut: boolean}} */ (frames[0]);
      const isBad = isAmongOthers && isSpoiled(past, looked, behind(), parameters);
      if (!isOut && !isBad) clean.push(echo);
      frames = frames.slice(1);
      past = [...past, looked].slice(-parameters.frames);
    }
    if (isAmongOthers) return clean;
    const rest = frames.filter(({ isOut }) => !isOut);
    frames = frames.map((frame) => ({ ...frame, isOut: true }));
    return [...clean, ...rest.map(({ echo }) => echo)];
  };

  return { take };
}

// Hears other phones in the slots of our turns, by the envelope that the echoes are cut by.

/**
 * @typedef {{slot: number, startS: number, playedS: number | null}} Slot when it starts, and when the own
 *   chirp in it is played
 */

/**
 * @param {import("./echo.js").EchoCutter} cutter
 * @param {number} periodS
 * @param {import("./hearing.js").MediumAccessParameters} parameters
 * @returns {{add: (slot: Slot) => void, take: () => import("./hearing.js").Heard[],
 *   clean: (echoes: import("./echo.js").Echo[]) => import("./echo.js").Echo[]}} take: what
 *   was heard in the slots that are over; after the first sound only. clean: echoes without those that others
 *   have spoiled, as long as others are about
 */
export function hearOthers({ heard }, periodS, parameters) {
  const hearing = makeHearing(ECHO_RATE_HZ, Math.round(periodS * ECHO_RATE_HZ), parameters);
  const spoiled = makeSpoiled(heard, parameters);
  /** @type {Slot[]} */
  let waiting = [];
  let alone = parameters.forget;
  const take = () => {
    for (const { slot, startS, playedS } of waiting) {
      const played = playedS === null ? null : heard.sampleAt(playedS);
      hearing.add({ slot, start: heard.sampleAt(startS), played });
    }
    waiting = [];
    const found = hearing.take(heard);
    for (const { othersS } of found) alone = othersS.length > 0 ? 0 : alone + 1;
    return found;
  };
  const clean = (/** @type {import("./echo.js").Echo[]} */ echoes) => spoiled.take(echoes, alone < parameters.forget);
  return { add: (slot) => waiting.push(slot), take, clean };
}

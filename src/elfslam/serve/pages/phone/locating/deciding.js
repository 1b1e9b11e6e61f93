/** When there is a fix, and what it is: footstep by footstep, or every 0.6 s of sound. */

import { fixOf } from "../../stages/locate.js";
import { REASONS } from "../../stages/spoofing.js";
import { marked } from "../../shared/marked.js";

/**
 * `decide(untilS)` gives the fixes that can be made once everything that was heard before `untilS` is in
 * the memory.
 * @typedef {{decide: (untilS: number) => Fix[]}} Deciding
 */

/**
 * @typedef {{reasonAt: (endS: number) => number}} SpoofingCheck number of the reason to suspect what was heard, 0
 *   for none
 * @typedef {import("./words.js").Fix} Fix
 * @typedef {import("../../stages/floor_map.js").FloorMap} FloorMap
 * @typedef {import("../../stages/floor_location.js").Floors} Floors
 * @typedef {import("../../stages/motion/filters.js").Step} Step
 */

/** @type {SpoofingCheck} */
const UNCHECKED = { reasonAt: () => 0 };
/** Why a tracker that is settled suspects what is heard. */
const JUMPS = marked("it sounds like a place that no step leads to");

/** Looking for footsteps goes through the last seconds of motion: not for every block of sound. */
const LOOK_EVERY_S = 0.2;

/**
 * A fix at each footstep.
 * @param {{
 *   floors: Floors, memory: ReturnType<typeof import("../../stages/pipeline.js").makeMemory>,
 *   footsteps: {take: (nowS: number) => Step[]},
 *   trackerIn: (floorMap: FloorMap) => ReturnType<typeof import("../../stages/track.js").makeTracker>,
 *   spoofing?: SpoofingCheck,
 * }} given trackerIn: a new one, wherever another floor is the walker's
 * @returns {Deciding}
 */
export function decideBySteps({ floors, memory, footsteps, trackerIn, spoofing = UNCHECKED }) {
  const ready = stepsUntil(footsteps);
  /** @type {FloorMap | null} */
  let followedIn = null;
  /** @type {ReturnType<typeof trackerIn>} */
  let tracker;
  /** @param {Step} step @returns {Fix} */
  const fixOfStep = ({ fromS, tS, moveM, sigma }) => {
    const { floorMap, scores, level } = floors.hear(tS, memory.mean(fromS, tS));
    const reason = spoofing.reasonAt(tS);
    memory.forget(tS);
    if (floorMap !== followedIn) [followedIn, tracker] = [floorMap, trackerIn(floorMap)];
    const fix = tracker.step(moveM, sigma, scores, reason > 0);
    return onFloor({ ...fix, tS, ...(fix.status === "SUSPECT" && { reason: reason > 0 ? REASONS[reason] : JUMPS }) }, level);
  };
  return { decide: (untilS) => ready(untilS).map(fixOfStep) };
}

/**
 * The footsteps that are over, once each; looked for now and then only.
 * @param {{take: (nowS: number) => Step[]}} footsteps @returns {(untilS: number) => Step[]}
 */
export function stepsUntil(footsteps) {
  /** @type {Step[]} */
  let waiting = [];
  let lookedS = -Infinity;
  return (untilS) => {
    if (untilS - lookedS < LOOK_EVERY_S) return [];
    lookedS = untilS;
    waiting.push(...footsteps.take(untilS));
    const ready = waiting.filter(({ tS }) => tS <= untilS);
    waiting = waiting.slice(ready.length);
    return ready;
  };
}

/**
 * A fix for every window of sound, one after the other, from the first echo on.
 * @param {{floors: Floors, locate: import("../../stages/locate.js").LocateParameters,
 *   memory: ReturnType<typeof import("../../stages/pipeline.js").makeMemory>, spoofing?: SpoofingCheck}} given
 * @returns {Deciding}
 */
export function decideByWindows({ floors, locate, memory, spoofing = UNCHECKED }) {
  /** @type {number | null} */
  let nextS = null;
  /** @param {number} fromS @param {number} toS */
  const fixOfWindow = (fromS, toS) => {
    const middleS = (fromS + toS) / 2;
    const { floorMap, scores, level } = floors.hear(middleS, memory.mean(fromS, toS));
    const fix = fixOf(scores, floorMap, locate, middleS);
    const reason = spoofing.reasonAt(toS);
    memory.forget(toS);
    return onFloor(reason > 0 ? suspected(fix, REASONS[reason]) : fix, level);
  };
  /** @param {number} untilS */
  const decide = (untilS) => {
    nextS ??= memory.firstS();
    /** @type {Fix[]} */
    const fixes = [];
    while (nextS !== null && nextS + locate.window_s <= untilS) {
      const fromS = nextS;
      nextS += locate.window_s;
      fixes.push(fixOfWindow(fromS, nextS));
    }
    return fixes;
  };
  return { decide };
}

/** @param {Fix} fix @param {string} reason @returns {Fix} */
function suspected({ tS, score }, reason) {
  return { tS, xyM: null, headingRad: NaN, covarianceM2: null, score, status: "SUSPECT", reason };
}

/** A place on a floor that is not known is one of several. @param {Fix} fix @param {number | null | undefined} level @returns {Fix} */
function onFloor(fix, level) {
  if (level === undefined) return fix;
  return { ...fix, level, status: level === null && fix.status === "OK" ? "AMBIGUOUS" : fix.status };
}

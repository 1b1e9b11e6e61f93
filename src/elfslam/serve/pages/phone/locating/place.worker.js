/**
 * The worker that locates. The audio thread sends it blocks of sound, the page readings of motion and when
 * chirps were played; it answers with fixes.
 */

import { makeChirp } from "../../stages/chirp.js";
import { makeEchoCutter } from "../../stages/echo.js";
import { encoderFor, openEncoder } from "../../stages/encoder.js";
import { checkedMap } from "../../stages/floor_map.js";
import { makeFootsteps } from "../../stages/motion/live.js";
import { makeTracker } from "../../stages/track.js";
import { makeSpoofingCheck } from "../../stages/spoofing.js";
import { makeRandom } from "../../stages/particles.js";
import { decideBySteps, decideByWindows } from "./deciding.js";
import { makeMemory } from "./memory.js";
import { delayMotion } from "./motion_delay.js";
import { hearOthers } from "../../stages/spoiled.js";
import { makePlacer } from "./placer.js";

/** Of the tracker's draws. */
const SEED = 0;

/**
 * @typedef {import("../../stages/floor_map.js").FloorMap} FloorMap
 * @typedef {import("../../stages/echo.js").EchoCutter} EchoCutter
 * @typedef {ReturnType<typeof hearOthers>} Others
 * @typedef {"track" | "one-shot"} Mode
 */

/** @type {ReturnType<typeof delayMotion>} */
let motion = { push() {} };
/** @type {Pick<EchoCutter, "played" | "latenessS">} */
let cutter = { played() {}, latenessS: () => null };
/** @type {Pick<Others, "add" | "take">} */
let others = { add() {}, take: () => [] };

const orders = {
  open: openMap,
  /** @param {{readings: import("./motion_delay.js").Reading[]}} order */
  motion: ({ readings }) => motion.push(readings),
  /** @param {{slot: import("../../stages/spoiled.js").Slot & {gainDb: number}}} order */
  slot({ slot }) {
    others.add(slot);
    if (slot.playedS === null) return;
    cutter.played(slot.playedS, slot.gainDb);
  },
};

self.onmessage = ({ data }) => orders[/** @type {keyof typeof orders} */ (data.do)](data);

/**
 * @param {{rateHz: number, floorMap: FloorMap, encoderBytes: Uint8Array<ArrayBuffer>, mode: Mode,
 *   source: MessagePort}} order
 */
async function openMap({ rateHz, floorMap, encoderBytes, mode, source }) {
  try {
    const placer = await placerFor(rateHz, checkedMap(floorMap), encoderBytes, mode);
    source.onmessage = ({ data }) => {
      placer.push(data.first, data.samples).catch(tellProblem);
      others.take().forEach((heard) => self.postMessage({ is: "heard", ...heard }));
    };
    self.postMessage({ is: "ready" });
  } catch (error) {
    tellProblem(error);
  }
}

/**
 * @param {number} rateHz @param {FloorMap} floorMap @param {Uint8Array<ArrayBuffer>} encoderBytes
 * @param {Mode} mode
 */
async function placerFor(rateHz, floorMap, encoderBytes, mode) {
  const { parameters } = floorMap;
  const listener = encoderFor(floorMap, await openEncoder(encoderBytes, {}));
  const echoes = makeEchoCutter({ rateHz, chirp: makeChirp(parameters.chirp, rateHz), parameters });
  const around = hearOthers(echoes, parameters.chirp.period_s, parameters.medium_access);
  [cutter, others] = [echoes, around];
  const memory = makeMemory(parameters.locate.fewest_echoes);
  const footsteps = makeFootsteps(parameters.motion);
  motion = delayMotion(footsteps, cutter.latenessS);
  const spoofing = makeSpoofingCheck(parameters.spoofing);
  const deciding = mode === "track"
    ? decideBySteps({ floorMap, memory, footsteps, spoofing, tracker: trackerOf(floorMap) })
    : decideByWindows({ floorMap, memory, spoofing });
  const { clean } = around;
  return makePlacer({ rateHz, cutter: echoes, clean, listener, spoofing, memory, deciding, onFix, onEcho });
}

/** @param {FloorMap} floorMap */
function trackerOf(floorMap) {
  return makeTracker(floorMap, floorMap.parameters.track, makeRandom(SEED));
}

/** @param {import("./words.js").Fix} fix */
function onFix(fix) {
  self.postMessage({ is: "fix", fix });
}

/** @param {import("../../stages/echo.js").Echo} echo */
function onEcho({ tS, facts }) {
  self.postMessage({ is: "echo", tS, facts, latenessS: cutter.latenessS() });
}

/** @param {unknown} error */
function tellProblem(error) {
  self.postMessage({ is: "problem", said: /** @type {Error} */ (error).message });
}

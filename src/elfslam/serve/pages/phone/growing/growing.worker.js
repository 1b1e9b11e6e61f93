/**
 * The worker that draws the map of a walk while it is recorded. It hears and moves as the worker that locates does,
 * and answers with sketches. A leg that begins anew after an interruption goes on with the same sketch.
 */

import { makeChirp } from "../../stages/chirp.js";
import { makeEchoCutter } from "../../stages/echo.js";
import { openEncoder } from "../../stages/encoder.js";
import { makeFootsteps } from "../../stages/motion/live.js";
import { makeMemory } from "../locating/memory.js";
import { delayMotion } from "../locating/motion_delay.js";
import { hearOthers } from "../../stages/spoiled.js";
import { makePlacer } from "../locating/placer.js";
import { drawBySteps, makeSketch } from "./sketch.js";

/** @type {ReturnType<typeof makeSketch> | null} */
let sketch = null;
/** @type {Promise<import("../../stages/encoder.js").Encoder> | null} */
let encoder = null;
/** What comes while the encoder opens waits for it. @type {Promise<void>} */
let open = Promise.resolve();
/** @type {ReturnType<typeof delayMotion>} */
let motion = { push() {} };
/** @type {Pick<import("../../stages/echo.js").EchoCutter, "played" | "latenessS">} */
let cutter = { played() {}, latenessS: () => null };
/** @type {Pick<ReturnType<typeof hearOthers>, "add">} */
let others = { add() {} };

const orders = {
  leg,
  /** @param {{readings: import("../locating/motion_delay.js").Reading[]}} order */
  motion: ({ readings }) => motion.push(readings),
  /** @param {{slot: import("../../stages/spoiled.js").Slot & {gainDb: number}}} order */
  slot({ slot }) {
    others.add(slot);
    if (slot.playedS !== null) cutter.played(slot.playedS, slot.gainDb);
  },
  /** @param {{name: string, tS: number}} order */
  mark: ({ name, tS }) => sketch?.mark(name, tS + (cutter.latenessS() ?? 0)),
};

self.onmessage = ({ data }) => {
  const done = open.then(() => orders[/** @type {keyof typeof orders} */ (data.do)](data));
  if (data.do === "leg") open = /** @type {Promise<void>} */ (done);
};

/**
 * @param {{rateHz: number, parameters: import("./growing.js").GrowingParameters,
 *   encoderBytes: Uint8Array<ArrayBuffer>, source: MessagePort}} order
 */
async function leg({ rateHz, parameters, encoderBytes, source }) {
  try {
    encoder ??= openEncoder(encoderBytes, {});
    sketch ? sketch.gap() : (sketch = makeSketch(parameters.closure));
    const placer = earOf(rateHz, parameters, await encoder, sketch);
    source.onmessage = ({ data }) => placer.push(data.first, data.samples).catch(tellProblem);
    self.postMessage({ is: "ready" });
  } catch (error) {
    tellProblem(error);
  }
}

/**
 * @param {number} rateHz @param {import("./growing.js").GrowingParameters} parameters
 * @param {import("../../stages/encoder.js").Encoder} listener @param {ReturnType<typeof makeSketch>} drawn
 */
function earOf(rateHz, parameters, listener, drawn) {
  const echoes = makeEchoCutter({ rateHz, chirp: makeChirp(parameters.chirp, rateHz), parameters });
  const around = hearOthers(echoes, parameters.chirp.period_s, parameters.medium_access);
  [cutter, others] = [echoes, around];
  const memory = makeMemory(parameters.locate.fewest_echoes);
  const footsteps = makeFootsteps(parameters.motion);
  motion = delayMotion(footsteps, cutter.latenessS);
  const deciding = drawBySteps({ sketch: drawn, memory, footsteps });
  const { clean, take } = around;
  const listening = makePlacer({ rateHz, cutter: echoes, clean, listener, memory, deciding, onFix: tellSketch });
  return {
    /** @param {number} first @param {Float32Array} samples */
    push(first, samples) {
      const done = listening.push(first, samples);
      take();
      return done;
    },
  };
}

/** @param {import("./sketch.js").Sketch} now */
function tellSketch(now) {
  self.postMessage({ is: "sketch", sketch: now });
}

/** @param {unknown} error */
function tellProblem(error) {
  self.postMessage({ is: "problem", said: /** @type {Error} */ (error).message });
}

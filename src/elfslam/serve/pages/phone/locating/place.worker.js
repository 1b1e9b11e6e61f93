/**
 * The worker that locates. The audio thread sends it blocks of sound, the page readings of motion and when
 * chirps were played; it answers with fixes.
 */

import { encoderFor, openEncoder } from "../../stages/encoder.js";
import { checkedMap } from "../../stages/floor_map.js";
import { makeRandom } from "../../stages/particles.js";
import { openPipeline } from "../../stages/pipeline.js";
import { makeSpoofingCheck } from "../../stages/spoofing.js";
import { makeTracker } from "../../stages/track.js";
import { decideBySteps, decideByWindows } from "./deciding.js";

/** Of the tracker's draws. */
const SEED = 0;

/**
 * @typedef {import("../../stages/floor_map.js").FloorMap} FloorMap
 * @typedef {"track" | "one-shot"} Mode
 */

/** @type {ReturnType<typeof openPipeline> | null} */
let pipeline = null;

const orders = {
  open: openMap,
  /** @param {{readings: import("../../stages/pipeline.js").Reading[]}} order */
  motion: ({ readings }) => pipeline?.motion(readings),
  /** @param {{slot: Parameters<ReturnType<typeof openPipeline>["slot"]>[0]}} order */
  slot: ({ slot }) => pipeline?.slot(slot),
};

self.onmessage = ({ data }) => orders[/** @type {keyof typeof orders} */ (data.do)](data);

/**
 * @param {{rateHz: number, floorMap: FloorMap, encoderBytes: Uint8Array<ArrayBuffer>, mode: Mode,
 *   source: MessagePort}} order
 */
async function openMap({ rateHz, floorMap, encoderBytes, mode, source }) {
  try {
    const opened = await pipelineFor(rateHz, checkedMap(floorMap), encoderBytes, mode);
    pipeline = opened;
    source.onmessage = ({ data }) => opened.push(data.first, data.samples).catch(tellProblem);
    self.postMessage({ is: "ready" });
  } catch (error) {
    tellProblem(error);
  }
}

/**
 * @param {number} rateHz @param {FloorMap} floorMap @param {Uint8Array<ArrayBuffer>} encoderBytes
 * @param {Mode} mode
 */
async function pipelineFor(rateHz, floorMap, encoderBytes, mode) {
  const { parameters } = floorMap;
  const listener = encoderFor(floorMap, await openEncoder(encoderBytes, {}));
  const spoofing = makeSpoofingCheck(parameters.spoofing);
  return openPipeline({
    rateHz, parameters, listener, spoofing, onFix, onEcho,
    onHeard: (heard) => self.postMessage({ is: "heard", ...heard }),
    decide: (memory, footsteps) => mode === "track"
      ? decideBySteps({ floorMap, memory, footsteps, spoofing, tracker: trackerOf(floorMap) })
      : decideByWindows({ floorMap, memory, spoofing }),
  });
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
  self.postMessage({ is: "echo", tS, facts, latenessS: pipeline?.latenessS() ?? null });
}

/** @param {unknown} error */
function tellProblem(error) {
  self.postMessage({ is: "problem", said: /** @type {Error} */ (error).message });
}

/**
 * The worker that locates. The audio thread sends it blocks of sound, the page readings of motion and when
 * chirps were played; it answers with fixes.
 */

import { encoderFor, openEncoder } from "../../stages/encoder.js";
import { makeFloors } from "../../stages/floor_location.js";
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
 * @typedef {import("../../stages/floor_location.js").Floor} Floor
 * @typedef {"track" | "one-shot"} Mode
 */

/** @type {ReturnType<typeof openPipeline> | null} */
let pipeline = null;
/** @type {ReturnType<typeof makeFloors> | null} */
let floors = null;

const orders = {
  open: openMap,
  /** @param {{readings: import("../../stages/pipeline.js").Reading[]}} order */
  motion: ({ readings }) => pipeline?.motion(readings),
  /** @param {{slot: Parameters<ReturnType<typeof openPipeline>["slot"]>[0]}} order */
  slot: ({ slot }) => pipeline?.slot(slot),
  /** The other floors of the building. @param {{floors: Floor[]}} order */
  join: ({ floors: others }) => floors?.join(others),
  /** The walker says where they are; what comes from now on is by that. @param {{floor: Floor | null}} order */
  say({ floor }) {
    floors?.say(floor);
    self.postMessage({ is: "said" });
  },
};

self.onmessage = ({ data }) => orders[/** @type {keyof typeof orders} */ (data.do)](data);

/**
 * @param {{rateHz: number, level: number | undefined, floorMap: FloorMap, encoderBytes: Uint8Array<ArrayBuffer>, mode: Mode,
 *   source: MessagePort}} order
 */
async function openMap({ rateHz, level, floorMap, encoderBytes, mode, source }) {
  try {
    const here = makeFloors({ level, floorMap: checkedMap(floorMap) });
    const opened = await pipelineFor(rateHz, here, floorMap, encoderBytes, mode);
    [pipeline, floors] = [opened, here];
    source.onmessage = ({ data }) => opened.push(data.first, data.samples).catch(tellProblem);
    self.postMessage({ is: "ready" });
  } catch (error) {
    tellProblem(error);
  }
}

/**
 * @param {number} rateHz @param {ReturnType<typeof makeFloors>} floors @param {FloorMap} floorMap that is open
 * @param {Uint8Array<ArrayBuffer>} encoderBytes @param {Mode} mode
 */
async function pipelineFor(rateHz, floors, floorMap, encoderBytes, mode) {
  const { parameters } = floorMap;
  const listener = encoderFor(floorMap, await openEncoder(encoderBytes, {}));
  const spoofing = makeSpoofingCheck(parameters.spoofing);
  return openPipeline({
    rateHz, parameters, listener, spoofing, onFix, onEcho,
    onHeard: (heard) => self.postMessage({ is: "heard", ...heard }),
    decide: (memory, footsteps) => mode === "track"
      ? decideBySteps({ floors, memory, footsteps, spoofing, trackerIn })
      : decideByWindows({ floors, locate: parameters.locate, memory, spoofing }),
  });
}

/** @param {FloorMap} floorMap */
function trackerIn(floorMap) {
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

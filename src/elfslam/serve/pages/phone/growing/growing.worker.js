/**
 * The worker that draws the map of a walk while it is recorded. It hears and moves as the worker that locates does,
 * and answers with sketches. A segment that begins anew after an interruption goes on with the same sketch.
 */

import { openEncoder } from "../../stages/encoder.js";
import { drawBySteps, makeSketch } from "./sketch.js";
import { openPipeline } from "../../stages/pipeline.js";

/** @type {ReturnType<typeof makeSketch> | null} */
let sketch = null;
/** @type {Promise<import("../../stages/encoder.js").Encoder> | null} */
let encoder = null;
/** What comes while the encoder opens waits for it. @type {Promise<void>} */
let open = Promise.resolve();
/** @type {ReturnType<typeof openPipeline> | null} */
let pipeline = null;

const orders = {
  segment,
  /** @param {{readings: import("../../stages/pipeline.js").Reading[]}} order */
  motion: ({ readings }) => pipeline?.motion(readings),
  /** @param {{slot: Parameters<ReturnType<typeof openPipeline>["slot"]>[0]}} order */
  slot: ({ slot }) => pipeline?.slot(slot),
  /** @param {{name: string, tS: number}} order */
  mark: ({ name, tS }) => sketch?.mark(name, tS + (pipeline?.latenessS() ?? 0)),
};

self.onmessage = ({ data }) => {
  const done = open.then(() => orders[/** @type {keyof typeof orders} */ (data.do)](data));
  if (data.do === "segment") open = /** @type {Promise<void>} */ (done);
};

/**
 * @param {{rateHz: number, parameters: import("./growing.js").GrowingParameters,
 *   encoderBytes: Uint8Array<ArrayBuffer>, source: MessagePort, echoDb: number | null}} order echoDb: as the phone's
 *   check measured it
 */
async function segment({ rateHz, parameters, encoderBytes, source, echoDb }) {
  try {
    encoder ??= openEncoder(encoderBytes, {});
    sketch ? sketch.gap() : (sketch = makeSketch(parameters.closure, echoDb));
    const drawn = sketch;
    const opened = openPipeline({
      rateHz, parameters, listener: await encoder, onFix: tellSketch,
      decide: (memory, footsteps) => drawBySteps({ sketch: drawn, memory, footsteps }),
    });
    pipeline = opened;
    source.onmessage = ({ data }) => opened.push(data.first, data.samples).catch(tellProblem);
    self.postMessage({ is: "ready" });
  } catch (error) {
    tellProblem(error);
  }
}

/** @param {import("./sketch.js").Sketch} now */
function tellSketch(now) {
  self.postMessage({ is: "sketch", sketch: now });
}

/** @param {unknown} error */
function tellProblem(error) {
  self.postMessage({ is: "problem", said: /** @type {Error} */ (error).message });
}

/** The map that grows while a walk is recorded: a worker is fed with what the walk hears, and its sketches are shown. */

import { sendMotion } from "../locating/place.js";
import { soundTime } from "../clocks.js";
import { mountGrowingMap } from "./growing_map.js";
import { showSketch, showWithout } from "./growing_view.js";

const PARAMETERS = new URL("../../stages/parameters.json", import.meta.url);
const ENCODER = new URL("../../stages/encoder.onnx", import.meta.url);

/**
 * What the server's line is set to, as far as drawing a walk needs it.
 * @typedef {{
 *   chirp: import("../../stages/chirp.js").ChirpParameters,
 *   echo: import("../../stages/echo.js").EchoParameters, motion: import("../../stages/motion/filters.js").MotionParameters,
 *   locate: {fewest_echoes: number}, medium_access: import("../../stages/medium_access.js").MediumAccessParameters,
 *   closure: import("../../stages/growing_graph.js").ClosureParameters,
 * }} GrowingParameters
 * @typedef {import("../devices.js").Devices} Devices
 * @typedef {{slot: number, start: number, played: number | null, gainDb: number}} Slot frames of the clock
 */

/**
 * The map of one walk. What cannot be drawn, as in a browser without WebAssembly, stops nothing: the walk is recorded
 * all the same.
 * @returns {{leg: (devices: Devices) => {slot: (slot: Slot) => void, end: () => void},
 *   mark: (name: string, pageMs: number) => void, leave: () => void}}
 */
export function startGrowing() {
  const worker = new Worker(new URL("./growing.worker.js", import.meta.url), { type: "module" });
  const files = fetchFiles();
  files.catch(() => showWithout());
  const map = mountGrowingMap();
  /** @type {(pageMs: number) => number} */
  let timeOf = () => 0;
  worker.onerror = () => showWithout();
  worker.onmessage = ({ data }) => {
    if (data.is === "problem") showWithout();
    if (data.is !== "sketch") return;
    map.show(data.sketch);
    showSketch(data.sketch);
  };

  /** @param {Devices} devices */
  const leg = ({ microphone, clocks }) => {
    const rateHz = microphone.context.sampleRate;
    const { port1, port2 } = new MessageChannel();
    timeOf = (pageMs) => soundTime(clocks.line(), pageMs);
    files.then(({ parameters, encoderBytes }) => {
      worker.postMessage({ do: "leg", rateHz, parameters, encoderBytes, source: port1 }, [port1]);
      microphone.pour("growing", port2);
    }, () => {});
    const stopMotion = sendMotion(worker, clocks);
    return {
      slot: (/** @type {Slot} */ { slot, start, played, gainDb }) => {
        const playedS = played === null ? null : played / rateHz;
        const order = { do: "slot", slot: { slot, startS: start / rateHz, playedS, gainDb } };
        files.then(() => worker.postMessage(order), () => {}); // behind the leg that it belongs to
      },
      end: () => {
        stopMotion();
        microphone.pour("growing", null);
      },
    };
  };

  return {
    leg,
    mark: (name, pageMs) => worker.postMessage({ do: "mark", name, tS: timeOf(pageMs) }),
    leave: () => {
      worker.terminate();
      map.leave();
    },
  };
}

/** @returns {Promise<{parameters: GrowingParameters, encoderBytes: Uint8Array<ArrayBuffer>}>} */
async function fetchFiles() {
  const [parameters, encoder] = await Promise.all([fetch(PARAMETERS), fetch(ENCODER)]);
  if (!parameters.ok || !encoder.ok) throw new Error(`${parameters.status}, ${encoder.status}`);
  return { parameters: await parameters.json(), encoderBytes: new Uint8Array(await encoder.arrayBuffer()) };
}

/** The encoder: the same ONNX file as in Python, run by onnxruntime's WebAssembly on one thread. */

import { ECHO_SAMPLES, ELF_SIZE, MEAN_NORMALISATION } from "./constants.js";
import { marked } from "../shared/marked.js";

const AT_ONCE = 256;
const VENDORED = new URL("../vendor/onnxruntime-web/", import.meta.url).href;

/**
 * `identity` is Python's: what must be equal for two features to be comparable. `embed` gives unit
 * vectors (n, 128) of traces (n, 2352); one call at a time.
 * @typedef {{identity: string, embed: (samples: Float32Array, n: number) => Promise<Float32Array>}} Encoder
 */

/**
 * onnxruntime, as far as it is used here.
 * @typedef {{
 *   Tensor: new (type: string, data: Float32Array, dims: number[]) => object,
 *   InferenceSession: {create: (bytes: Uint8Array, options: object) => Promise<Session>},
 *   env: {wasm: {wasmPaths: string, numThreads: number}, logLevel: string},
 * }} Runtime
 * @typedef {{
 *   run: (feeds: {samples: object}) => Promise<{elf: {data: Float32Array}}>,
 *   inputNames: string[], outputNames: string[], inputMetadata: {name: string, shape?: (number | string)[]}[],
 * }} Session
 */

/**
 * An encoder from the bytes of its file. Throws RangeError where they are none.
 * @param {Uint8Array<ArrayBuffer>} bytes
 * @param {{wasmFolder?: string}} given the address of the runtime's folder, with a slash behind
 * @returns {Promise<Encoder>}
 */
export async function openEncoder(bytes, { wasmFolder = VENDORED } = {}) {
  const runtime = await openRuntime(wasmFolder);
  const session = await openSession(runtime, bytes);

  /** @param {Float32Array} samples @param {number} n */
  const embedSome = async (samples, n) => {
    const { elf } = await session.run({ samples: new runtime.Tensor("float32", samples, [n, ECHO_SAMPLES]) });
    return elf.data;
  };

  /** @param {Float32Array} samples @param {number} n */
  const embed = async (samples, n) => {
    checkTraces(samples, n);
    const parts = [];
    for (let k = 0; k < n; k += AT_ONCE) {
      const rows = samples.subarray(k * ECHO_SAMPLES, Math.min(k + AT_ONCE, n) * ECHO_SAMPLES);
      parts.push(await embedSome(rows, rows.length / ECHO_SAMPLES));
    }
    return parts.length === 1 ? parts[0] : Float32Array.from(parts.flatMap((part) => [...part]));
  };

  const identity = (await sha256(bytes)).slice(0, 16);
  // The first echo takes the runtime much longer than those behind it.
  checkElf(await embed(new Float32Array(ECHO_SAMPLES), 1));
  return { identity, embed };
}

/**
 * The encoder, if it made the map. Throws RangeError where another did.
 * @param {import("./floor_map.js").FloorMap} floorMap
 * @param {Encoder} encoder
 * @returns {Encoder}
 */
export function encoderFor(floorMap, encoder) {
  if (floorMap.encoder !== encoder.identity) {
    throw new RangeError(
      `map: made with encoder ${floorMap.encoder}, got ${encoder.identity}; fetch the map again with its encoder`,
    );
  }
  return encoder;
}

/** @param {BufferSource} bytes @returns {Promise<string>} hexadecimal */
async function sha256(bytes) {
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
  return Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/**
 * The runtime, without threads: those want headers that forbid much else, and memory.
 * @param {string} wasmFolder @returns {Promise<Runtime>}
 */
async function openRuntime(wasmFolder) {
  const runtime = await import(`${wasmFolder}ort.wasm.min.mjs`);
  runtime.env.wasm.wasmPaths = wasmFolder;
  runtime.env.wasm.numThreads = 1;
  runtime.env.logLevel = "error";
  return runtime;
}

/** @param {Runtime} runtime @param {Uint8Array} bytes @returns {Promise<Session>} */
async function openSession(runtime, bytes) {
  const options = { executionProviders: ["wasm"], logSeverityLevel: 3 };
  let session;
  try {
    session = await runtime.InferenceSession.create(bytes, options);
  } catch (cause) {
    throw new RangeError(marked("encoder: not a readable ONNX graph; fetch the map again"), { cause });
  }
  const samples = session.inputMetadata.find(({ name }) => name === "samples");
  if (samples?.shape?.[1] !== ECHO_SAMPLES || !session.outputNames.includes("elf")) {
    throw new RangeError(
      `encoder: wanted input samples (n, ${ECHO_SAMPLES}) and output elf, ` +
        `got ${session.inputNames} and ${session.outputNames}; make the map again`,
    );
  }
  return session;
}

/** @param {Float32Array} elf */
function checkElf(elf) {
  if (elf.length !== ELF_SIZE) {
    throw new RangeError(`encoder: wanted ${ELF_SIZE} numbers for an echo, got ${elf.length}; make the map again`);
  }
}

/** @param {Float32Array} samples @param {number} n */
function checkTraces(samples, n) {
  if (samples.length !== n * ECHO_SAMPLES) {
    throw new RangeError(
      `echoes: wanted ${n} of ${ECHO_SAMPLES} samples, got ${samples.length} samples; cut them again`,
    );
  }
}

// What all echoes of a walk have in common is the phone's and tells no place: as elfslam.stages.feature takes it away.

/** A walk begins with so many echoes of nothing; an echo is compared with the one so many before it: above that cosine
 * the phone stands, and the echo hardly counts, or the mean would fill with that place. */
const { PRIOR_FRAMES, STILL_ECHOES, STILL, STILL_WEIGHT } = MEAN_NORMALISATION;

/**
 * Takes the unit vectors (n, 128) of a walk as they come and gives each less the mean of those so far, made unit again.
 * @returns {(vectors: Float32Array) => Float32Array}
 */
export function makeMeanNormalisation() {
  const sum = new Float64Array(ELF_SIZE);
  let counted = PRIOR_FRAMES;
  /** @type {Float32Array[]} */
  let lately = [];

  /** @param {Float32Array} vector */
  const count = (vector) => {
    const isStill = lately.length === STILL_ECHOES && cosine(vector, lately[0]) > STILL;
    lately = [...lately, vector.slice()].slice(-STILL_ECHOES);
    const weight = isStill ? STILL_WEIGHT : 1;
    counted += weight;
    vector.forEach((value, d) => (sum[d] += weight * value));
  };

  /** @param {Float32Array} vector */
  const own = (vector) => {
    count(vector);
    const rest = Float64Array.from(vector, (value, d) => value - sum[d] / counted);
    const length = Math.max(Math.hypot(...rest), 1e-12);
    return rest.map((value) => value / length);
  };

  return (vectors) => {
    const normalised = new Float32Array(vectors.length);
    for (let at = 0; at < vectors.length; at += ELF_SIZE) normalised.set(own(vectors.subarray(at, at + ELF_SIZE)), at);
    return normalised;
  };
}

/** @param {Float32Array} a @param {Float32Array} b unit vectors */
function cosine(a, b) {
  return a.reduce((total, value, d) => total + value * b[d], 0);
}

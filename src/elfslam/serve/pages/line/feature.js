/** Features: what an encoder makes of echoes, heard as the phone that made the map would hear them. */

import { median } from "../phone/matched_filter.js";
import { BINS, ECHO_SAMPLES, sha256 } from "./encoder.js";

const WINDOW = 96;
const HOP = 48;
const FRAMES = 1 + (ECHO_SAMPLES - WINDOW) / HOP;
const FIRST_BIN = 33;
/** Added to magnitudes before the logarithm, so that silence has one. */
const QUIET = 1e-7;
/** Echoes (a minute) of which the phone's own response is known. */
const REMEMBERED = 600;

const TURNS = rows((bin) => (n) => -(2 * Math.PI * ((FIRST_BIN + bin) * n)) / WINDOW);
const HANN = Float64Array.from({ length: WINDOW }, (_, n) => 0.5 - 0.5 * Math.cos((2 * Math.PI * n) / WINDOW));
const COS = TURNS.map((angles) => angles.map((angle, n) => HANN[n] * Math.cos(angle)));
const SIN = TURNS.map((angles) => angles.map((angle, n) => HANN[n] * Math.sin(angle)));

function rows(angleOf) {
  return Array.from({ length: BINS }, (_, bin) => Float64Array.from({ length: WINDOW }, (_, n) => angleOf(bin)(n)));
}

/**
 * The level of each band (12) in one aligned trace (2352), less the mean over the bands.
 * @param {Float32Array} trace
 * @returns {Float64Array}
 */
export function bandLevels(trace) {
  const levels = new Float64Array(BINS);
  for (let bin = 0; bin < BINS; bin += 1) {
    for (let frame = 0; frame < FRAMES; frame += 1) {
      levels[bin] += Math.log(magnitude(trace, frame * HOP, bin) + QUIET) / FRAMES;
    }
  }
  return lessMean(levels);
}

function magnitude(trace, from, bin) {
  const [cos, sin] = [COS[bin], SIN[bin]];
  let re = 0;
  let im = 0;
  for (let n = 0; n < WINDOW; n += 1) {
    re += trace[from + n] * cos[n];
    im += trace[from + n] * sin[n];
  }
  return Math.hypot(re, im);
}

/**
 * What a phone makes of the chirp (12), from the `bandLevels` of some traces: their median.
 * @param {Float64Array[]} levels
 * @returns {Float32Array}
 */
export function meanLogSpectrum(levels) {
  const found = Float64Array.from({ length: BINS }, (_, bin) => median(levels.map((each) => each[bin])));
  return Float32Array.from(lessMean(found));
}

function lessMean(values) {
  const mean = values.reduce((sum, value) => sum + value, 0) / values.length;
  return values.map((value) => value - mean);
}

/**
 * `embed` takes the traces (n, 2352) that came since the last time and gives their unit vectors.
 * @typedef {{identity: string, embed: (samples: Float32Array, n: number) => Promise<Float32Array>}} Listener
 */

/**
 * The encoder for this phone and a map. Where the map says as whom to hear it, the phone's own response
 * is that of the last minute's echoes; Python takes it of the whole recording.
 * Throws RangeError where the map was made with another encoder.
 * @param {import("./floor_map.js").FloorMap} floorMap
 * @param {import("./encoder.js").Encoder} encoder
 * @returns {Promise<Listener>}
 */
export async function encoderFor(floorMap, encoder) {
  const identity = encoder.identity + (await suffixOf(floorMap.phone));
  if (floorMap.encoder !== identity) {
    throw new RangeError(
      `map: made with encoder ${floorMap.encoder}, got ${identity}; fetch the map again with its encoder`,
    );
  }
  if (!floorMap.phone) return { identity, embed: (samples, n) => encoder.embed(samples, n) };
  const response = makeResponse(floorMap.phone);
  const embed = (samples, n) => encoder.embed(samples, n, response(samples, n));
  return { identity, embed };
}

async function suffixOf(phone) {
  if (!phone) return "";
  const bytes = new Uint8Array(Float32Array.from(phone).buffer);
  return `+as-${(await sha256(bytes)).slice(0, 8)}`;
}

/** What is to be taken out of this phone's echoes (12), after some more of them. */
function makeResponse(reference) {
  let levels = [];
  return (samples, n) => {
    const traces = Array.from({ length: n }, (_, k) => samples.subarray(k * ECHO_SAMPLES, (k + 1) * ECHO_SAMPLES));
    levels = [...levels, ...traces.map(bandLevels)].slice(-REMEMBERED);
    return meanLogSpectrum(levels).map((heard, bin) => heard - reference[bin]);
  };
}

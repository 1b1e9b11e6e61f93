/**
 * The worker behind the microphone. The audio thread sends it blocks; the page tells it what to do with
 * them: nothing, gather them for the probe, or frame them and hand the bytes to the storage.
 */

import { excitationOf, periodSamples } from "../stages/chirp.js";
import { FRAME_HEADERS, makeFramer, wavHeader } from "./framer.js";
import { makeHearing } from "../stages/hearing.js";
import { measure } from "./probe.js";

/**
 * @typedef {import("./framer.js").Kind} Kind
 * @typedef {import("../stages/hearing.js").Told} Told
 * @typedef {{rateHz: number, chirp: import("../stages/chirp.js").Chirp}} Played
 * @typedef {[name: string, bytes: Uint8Array][]} Parts of files
 */

/** Both are there from the page's first order on, `open`. */
let sound = /** @type {Played & {samples: Float32Array}} */ (/** @type {unknown} */ (null));
let storage = /** @type {MessagePort} */ (/** @type {unknown} */ (null));
/** @type {(first: number, samples: Float32Array) => void} */
let take = (_first, _samples) => {};
let finish = () => {};
/** @type {(slot: Told) => void} */
let note = (_slot) => {};

const orders = {
  /** @param {Played & {source: MessagePort, store: MessagePort}} order */
  open({ rateHz, chirp, source, store }) {
    sound = { rateHz, chirp, samples: excitationOf(chirp, rateHz) };
    storage = store;
    source.onmessage = ({ data }) => take(data.first, data.samples);
  },
  listen: startListening,
  measure: answerMeasured,
  record: startRecording,
  /** @param {{slot: Told}} order */
  slot: ({ slot }) => note(slot),
  stop: () => finish(),
};

self.onmessage = ({ data }) => orders[/** @type {keyof typeof orders} */ (data.do)](data);

/** @type {{first: number, samples: Float32Array}[]} */
let heard = [];

function startListening() {
  heard = [];
  take = (first, samples) => heard.push({ first, samples });
}

/**
 * `due` is the frame of the context's clock at which the first of `count` chirps was played. What the microphone did
 * not give is silence.
 * @param {{due: number, count: number}} order
 */
function answerMeasured({ due, count }) {
  take = () => {};
  const period = periodSamples(sound.chirp, sound.rateHz);
  const ends = heard.map(({ first, samples }) => first + samples.length);
  const from = Math.min(due, ...heard.map(({ first }) => first));
  const all = new Float32Array(Math.max(due + (count + 1) * period, ...ends) - from);
  heard.forEach(({ first, samples }) => all.set(samples, first - from));
  heard = [];
  const played = { first: due - from, period, count };
  const measured = measure(all, sound.rateHz, sound.samples, played, sound.chirp.band_hz);
  self.postMessage({ is: "measured", measured });
}

/**
 * Recording begins with the next block; its first sample is the recording's time `fromS`: 0, or later where a
 * walk goes on that was interrupted, of whose files so much is `kept`. `latencyS` is how long sound took from
 * playing to hearing until now, null where nobody knows.
 * @param {{walk: string, kind: Kind, latencyS?: number | null, fromS?: number, kept?: Record<string, number>,
 *   mediumAccess: import("../stages/hearing.js").MediumAccessParameters}} order
 */
function startRecording({ walk, kind, mediumAccess, latencyS = null, fromS = 0, kept = {} }) {
  const { rateHz } = sound;
  const period = periodSamples(sound.chirp, rateHz);
  const late = latencyS === null ? null : Math.round(latencyS * rateHz);
  const origin = Math.round(fromS * rateHz);
  const framer = makeFramer({ rateHz, chirp: sound.samples, period, kind, late, origin });
  const hearing = makeHearing(rateHz, period, mediumAccess);
  /** @type {number | null} */
  let begun = null;
  let zero = 0;
  note = ({ slot, start, played }) => {
    if (played !== null) framer.played(played - zero);
    hearing.add({ slot, start: start - zero, played: played === null ? null : played - zero });
  };
  sizes = Object.fromEntries(FILES[kind].map((name) => [name, kept[name] ?? 0]));
  if (sizes[FILES[kind][0]] === 0) keepHeaders(walk, kind);
  take = (first, samples) => {
    if (begun === null) {
      begun = first;
      zero = first - origin;
      self.postMessage({ is: "started", zero });
    }
    const { frames, missing } = framer.push(first - zero, samples);
    const at = (first - zero) / sound.rateHz;
    if (missing > 0) self.postMessage({ is: "gap", tS: at, lostS: missing / sound.rateHz });
    frames.forEach((frame) => keepFrame(walk, kind, frame));
    hearing.take(framer.heard).forEach((heard) => self.postMessage({ is: "heard", ...heard }));
  };
  finish = () => {
    take = () => {};
    finish = () => {};
    note = () => {};
    self.postMessage({ is: "stopped", seconds: framer.end() / sound.rateHz, sizes });
  };
}

const FILES = { baseband: ["baseband.csv", "baseband.iq"], whole: ["frames.csv", "frames.wav"] };

/** @param {string} walk @param {Kind} kind */
function keepHeaders(walk, kind) {
  const [table, file] = FILES[kind];
  const header = kind === "whole" ? wavHeader(sound.rateHz) : new Uint8Array(0);
  keep(walk, [[table, new TextEncoder().encode(FRAME_HEADERS[kind])], [file, header]]);
}

/**
 * The row goes before its frame: what is found after a crash can be told from it. How late the chirp came is
 * null where nobody told when it was played.
 * @param {string} walk @param {Kind} kind @param {import("./framer.js").Frame} frame
 */
function keepFrame(walk, kind, { arrival, tS, row, bytes }) {
  const [table, file] = FILES[kind];
  keep(walk, [[table, new TextEncoder().encode(row)], [file, bytes]]);
  const directS = arrival.sample / sound.rateHz;
  const jumpedS = arrival.jumped / sound.rateHz;
  const lateS = arrival.played === undefined ? null : (arrival.sample - arrival.played) / sound.rateHz;
  self.postMessage({ is: "frame", tS, directS, lateS, jumpedS, isFound: arrival.isFound, peak: arrival.peak });
}

/** @type {Record<string, number>} */
let sizes = {};

/** @param {string} walk @param {Parts} parts */
function keep(walk, parts) {
  for (const [name, bytes] of parts) sizes[name] = (sizes[name] ?? 0) + bytes.length;
  storage.postMessage(
    { do: "append", walk, parts },
    parts.map(([, bytes]) => /** @type {ArrayBuffer} */ (bytes.buffer)),
  );
}

/**
 * A simulated walker in the place of this phone's sound and motion, for a computer without either: what their phone
 * heard and felt (`demonstration/`, by `python -m studies.demonstration`) comes in as if it happened now, or four times
 * as fast. All clocks run so much faster then, and the rest of the page sees nothing but a phone.
 */

import { Problem } from "../shared/api.js";
import { ECHO_RATE_HZ as RATE_HZ } from "../stages/constants.js";
import { t } from "../shared/words.js";
import { startSound } from "./devices.js";
import { accelerationSign } from "./motion.js";

const PUMP_EVERY_MS = 20;
/** So far ahead chirps are announced. */
const AHEAD_S = 1.5;
/** A microphone that hears nothing has noise. */
const NOISE = 1e-4;
/** Untouched, as a good phone says it. */
const SETTINGS = { sampleRate: RATE_HZ, echoCancellation: false, noiseSuppression: false, autoGainControl: false };

/**
 * @typedef {{sound: Float32Array, played: number[][], motion: number[][]}} SimulatedWalk played: rows of time (s) and
 *   level (dB); motion: rows of time (s), acceleration x y z with gravity (m/s2) and rate of turn x y z (rad/s)
 * @typedef {import("./devices.js").Devices & {close: () => void}} SimulatedDevices
 */

/**
 * @param {"walk" | "other"} name which walk: the one that maps, or that of somebody else in the same room
 * @returns {Promise<SimulatedWalk>} Raises Problem
 */
export async function fetchWalk(name) {
  const [sound, told] = await Promise.all(["flac", "json"].map((ending) => fetch(`demonstration/${name}.${ending}`)));
  if (!sound.ok || !told.ok) throw new Problem(t("The simulated walk is not on this server."), sound.status);
  const decoder = new OfflineAudioContext(1, 1, RATE_HZ);
  const decoded = await decoder.decodeAudioData(await sound.arrayBuffer());
  return { sound: decoded.getChannelData(0), ...(await told.json()) };
}

/**
 * @param {SimulatedWalk} walk @param {number} speed of time
 * @param {import("./storage_client.js").StorageClient} storage @param {import("../stages/chirp.js").Chirp} chirp
 * @param {() => void} over is told when the walk has ended
 * @returns {SimulatedDevices}
 */
export function simulatedDevices(walk, speed, storage, chirp, over) {
  const context = new VirtualContext(speed);
  /** @type {Map<string, MessagePort>} */
  const sinks = new Map();
  /** When the walk begins, in seconds of the clock. */
  let beginsS = Infinity;
  const sendSound = makeSound(walk, context, sinks, () => beginsS);
  const sendMotion = makeMotion(walk, context, () => beginsS);
  const endS = walk.sound.length / RATE_HZ;
  const pump = setInterval(() => {
    sendMotion();
    sendSound();
    if (context.currentTime < beginsS + endS) return;
    beginsS = Infinity;
    over();
  }, PUMP_EVERY_MS);
  const track = Object.assign(new EventTarget(), { label: t("Simulated phone"), getSettings: () => SETTINGS, stop: () => {} });
  const microphone = /** @type {import("./microphone.js").Microphone} */ (/** @type {unknown} */ ({
    context, track, told: new EventTarget(), listenTo: async () => {},
    pour: (/** @type {string} */ to, /** @type {MessagePort | null} */ sink) => (sink ? sinks.set(to, sink) : sinks.delete(to)),
    close: async () => close(),
  }));
  const close = () => {
    clearInterval(pump);
    context.close();
  };
  /** @type {import("./devices.js").Devices["playSlots"]} */
  const playSlots = (delayS, tell) => {
    beginsS = context.currentTime + delayS;
    const stop = announce(walk.played, beginsS, context, tell);
    return { heard: () => {}, stop: () => {
      beginsS = Infinity;
      return stop();
    } };
  };
  return {
    microphone, playSlots, close, isMotionAllowed: true,
    sound: startSound(microphone, storage, chirp),
    play: () => ({ firstFrame: 0, stop: () => 0 }), // nobody checks a phone that is none
    clocks: { line: () => ({ originMs: context.begunMs, originS: 0, rate: speed }), stop: () => {} },
  };
}

/** What the page asks of an audio context, on a clock of another speed. */
class VirtualContext extends EventTarget {
  /** @param {number} speed */
  constructor(speed) {
    super();
    this.speed = speed;
    this.begunMs = performance.now();
    this.sampleRate = RATE_HZ;
    this.state = "running";
    this.outputLatency = 0;
  }

  get currentTime() {
    return (this.speed * (performance.now() - this.begunMs)) / 1000;
  }

  async resume() {}

  close() {
    this.state = "closed";
  }
}

/**
 * Sends what the microphone heard since it was last sent.
 * @param {SimulatedWalk} walk @param {VirtualContext} context @param {Map<string, MessagePort>} sinks
 * @param {() => number} beginsS
 */
function makeSound({ sound }, context, sinks, beginsS) {
  let first = 0;
  return () => {
    const end = Math.floor(context.currentTime * RATE_HZ);
    const begin = Math.round(Math.min(beginsS(), 1e9) * RATE_HZ);
    for (const sink of sinks.values()) {
      const samples = Float32Array.from({ length: end - first }, (_, k) => (sound[first + k - begin] ?? 0) + NOISE * (Math.random() - 0.5));
      sink.postMessage({ first, samples }, [samples.buffer]);
    }
    first = end;
  };
}

/**
 * Sends the motion since it was last sent, each reading with the moment at which it was taken; before the walk, and
 * after it, the walker stands.
 * @param {SimulatedWalk} walk @param {VirtualContext} context @param {() => number} beginsS
 */
function makeMotion({ motion }, context, beginsS) {
  const sign = accelerationSign(navigator);
  const everyS = motion[motion.length - 1][0] / (motion.length - 1);
  let lastS = 0;
  /** @param {number} atS @param {number[]} row */
  const send = (atS, [, ...values]) => {
    const [x, y, z] = values.slice(0, 3).map((value) => sign * value);
    const degrees = values.slice(3).map((radians) => (radians * 180) / Math.PI);
    const event = new Event("devicemotion");
    Object.defineProperty(event, "timeStamp", { value: context.begunMs + (1000 * atS) / context.speed });
    Object.assign(event, {
      accelerationIncludingGravity: { x, y, z },
      rotationRate: { alpha: degrees[0], beta: degrees[1], gamma: degrees[2] },
    });
    window.dispatchEvent(event);
  };
  return () => {
    const nowS = context.currentTime;
    const begins = beginsS();
    for (; lastS + everyS < nowS; lastS += everyS) {
      const row = Math.round((lastS - begins) / everyS);
      send(lastS, motion[row] ?? [0, ...motion[0].slice(1, 4), 0, 0, 0]);
    }
  };
}

/**
 * Tells of each chirp of the walk in advance, as a player would; gives what ends that.
 * @param {number[][]} chirps @param {number} beginsS @param {VirtualContext} context
 * @param {Parameters<import("./devices.js").Devices["playSlots"]>[1]} tell
 */
function announce(chirps, beginsS, context, tell) {
  let slot = 0;
  const tellDue = () => {
    for (; slot < chirps.length && beginsS + chirps[slot][0] < context.currentTime + AHEAD_S; slot += 1) {
      const [playedS, gainDb] = chirps[slot];
      const played = Math.round((beginsS + playedS) * RATE_HZ);
      tell({ slot, start: played, played, gainDb });
    }
  };
  tellDue();
  const timer = setInterval(tellDue, PUMP_EVERY_MS);
  return () => {
    clearInterval(timer);
    return context.currentTime * RATE_HZ;
  };
}

/** Microphone, loudspeaker and motion of this phone, as walking and locating share them. */

import { excitationOf, periodSamples } from "../stages/chirp.js";
import { afterSlot, initialSchedule, isPlayed } from "../stages/hearing.js";
import { watchClocks } from "./clocks.js";
import { keptChoice, openMicrophone } from "./microphone.js";
import { allowMotion } from "./motion.js";

/**
 * @typedef {{
 *   microphone: import("./microphone.js").Microphone, sound: Sound,
 *   clocks: ReturnType<typeof watchClocks>, isMotionAllowed: boolean,
 *   play: (delayS: number, count?: number) => ReturnType<typeof startChirps>,
 *   playSlots: (delayS: number, tell: (slot: {slot: number, start: number, played: number | null,
 *     gainDb: number}) => void,
 *     parameters?: import("../stages/hearing.js").MediumAccessParameters) => ReturnType<typeof startSlots>,
 * }} Devices
 */

/**
 * Must be called from a tap. Raises Problem.
 * @param {import("./storage_client.js").StorageClient} storage @param {import("../stages/chirp.js").Chirp} chirp
 * @param {import("../stages/hearing.js").MediumAccessParameters} mediumAccess as the server takes them
 * @returns {Promise<Devices>}
 */
export async function openDevices(storage, chirp, mediumAccess) {
  const motion = allowMotion();
  const microphone = await openMicrophone(keptChoice()?.chosen);
  const isMotionAllowed = await motion;
  const sound = startSound(microphone, storage, chirp);
  const rateHz = microphone.context.sampleRate;
  const samples = excitationOf(chirp, rateHz);
  const period = periodSamples(chirp, rateHz);
  /** @type {Devices["play"]} */
  const play = (delayS, count) => startChirps(microphone.context, samples, period, delayS, count);
  /** @type {Devices["playSlots"]} */
  const playSlots = (delayS, tell, parameters = mediumAccess) =>
    startSlots(microphone.context, samples, period, delayS, parameters, tell);
  return { microphone, sound, play, playSlots, clocks: watchClocks(microphone.context), isMotionAllowed };
}

// Keeps the screen on: browsers let go of the lock whenever the page is hidden, and refuse it to save the battery.

/**
 * @param {HTMLElement} refusal says that the screen may go dark; shown while it may
 * @returns {{stop: () => void}}
 */
export function stayAwake(refusal) {
  /** @type {WakeLockSentinel | null} */
  let lock = null;
  let isWanted = true;
  const request = async () => {
    if (!isWanted || document.visibilityState !== "visible") return;
    lock = (await navigator.wakeLock?.request("screen").catch(() => null)) ?? null;
    lock?.addEventListener("release", request);
    if (isWanted) refusal.hidden = lock !== null;
    else lock?.release();
  };
  document.addEventListener("visibilitychange", request);
  request();
  return {
    stop: () => {
      isWanted = false;
      document.removeEventListener("visibilitychange", request);
      refusal.hidden = true;
      lock?.release();
    },
  };
}

// The page's side of the sound's worker: orders, answers that are waited for, and frames as they come.

/**
 * @typedef {{
 *   order: (order: object, transfer?: Transferable[]) => void,
 *   answer: (kind: string) => Promise<any>,
 *   on: (kind: string, heard: (news: any) => void) => void,
 * }} Sound
 */

/**
 * @param {import("./microphone.js").Microphone} microphone
 * @param {import("./storage_client.js").StorageClient} storage
 * @param {import("../stages/chirp.js").Chirp} chirp
 * @returns {Sound}
 */
export function startSound(microphone, storage, chirp) {
  const worker = new Worker(new URL("./sound.worker.js", import.meta.url), { type: "module" });
  const listeners = new Map();
  /** @type {Sound["on"]} */
  const on = (kind, heard) => listeners.set(kind, heard);
  /** @type {Sound["answer"]} */
  const answer = (kind) => new Promise((resolve) => on(kind, resolve));
  /** @type {Sound["order"]} */
  const order = (message, transfer = []) => worker.postMessage(message, transfer);
  worker.onmessage = ({ data }) => listeners.get(data.is)?.(data);
  const { port1, port2 } = new MessageChannel();
  const store = storage.port();
  order(
    { do: "open", rateHz: microphone.context.sampleRate, chirp, source: port1, store },
    [port1, store],
  );
  microphone.pour("sound", port2);
  return { order, answer, on };
}

/** Chirps after a moment of silence: what the phone is checked with, and what a microphone is tried with. */
const CHECK = { quietS: 0.6, chirps: 20 };
export const TRIAL = { quietS: 0.2, chirps: 6 };
const TAIL_S = 0.4;

/**
 * Plays chirps after a moment of silence, and measures what comes back.
 * @param {Sound} sound
 * @param {(delayS: number, count: number) => {firstFrame: number}} play
 * @param {number} periodS
 * @returns {Promise<import("./probe.js").Measured>}
 */
export async function probeSound(sound, play, periodS, { quietS, chirps } = CHECK) {
  sound.order({ do: "listen" });
  const { firstFrame } = play(quietS, chirps);
  await new Promise((resolve) => {
    setTimeout(resolve, 1000 * (quietS + chirps * periodS + TAIL_S));
  });
  const measured = sound.answer("measured");
  sound.order({ do: "measure", due: firstFrame, count: chirps });
  return (await measured).measured;
}

// Plays the chirps: one source per chirp, each put on its sample of the audio clock in advance.

/** So far ahead chirps are put on the clock: a page in the background wakes up once a second. */
const AHEAD_S = 3;
/** A page that is seen wakes up in time, and what it has heard of others counts sooner. */
const SEEN_AHEAD_S = 1.5;
const AMONG_OTHERS_AHEAD_S = 0.4;
const EVERY_MS = 100;
/** Too late to be called back. */
const MARGIN_S = 0.05;
/** Of full scale: leaves room for resampling on the way to the loudspeaker. */
const LEVEL = 0.8;

/**
 * Chirps once per period.
 * @param {AudioContext} context
 * @param {Float32Array<ArrayBuffer>} chirp samples at the context's rate
 * @param {number} period samples
 * @param {number} delayS from now to the first chirp
 * @param {number} [count] chirps in all; without it they go on until stopped
 * @returns {{firstFrame: number, stop: () => number}} firstFrame: of the clock, at which the first one
 *   begins; stop: lets those that sound end, and gives the frame at which the last one begins
 */
export function startChirps(context, chirp, period, delayS, count = Infinity) {
  const speaker = openSpeaker(context, chirp);
  const firstFrame = Math.ceil((context.currentTime + delayS) * context.sampleRate);
  let next = 0;

  const schedule = () => {
    const now = context.currentTime * context.sampleRate;
    const until = now + AHEAD_S * context.sampleRate;
    for (; next < count && firstFrame + next * period < until; next += 1) {
      const frame = firstFrame + next * period;
      if (frame > now) speaker.play(frame);
    }
  };

  schedule();
  const timer = setInterval(schedule, EVERY_MS);
  const stop = () => {
    clearInterval(timer);
    const limit = speaker.stop();
    return firstFrame + Math.max(Math.floor((limit - firstFrame) / period), 0) * period;
  };
  return { firstFrame, stop };
}

/**
 * Chirps by turns: at a random moment of each slot of one period that is ours, each by chance at full level or
 * softer. Nobody else can know.
 * @param {AudioContext} context
 * @param {Float32Array<ArrayBuffer>} chirp samples at the context's rate
 * @param {number} period samples
 * @param {number} delayS from now to the first slot
 * @param {import("../stages/hearing.js").MediumAccessParameters} parameters
 * @param {(slot: {slot: number, start: number, played: number | null, gainDb: number}) => void} tell of
 *   each slot in its order and in advance; start and played are frames of the clock, gainDb is how loud
 * @returns {{heard: (slot: number, othersS: number[], played: boolean) => void, stop: () => number}} heard:
 *   tells what was heard in a slot; stop: gives the frame from which on nothing is played any more
 */
export function startSlots(context, chirp, period, delayS, parameters, tell) {
  const rateHz = context.sampleRate;
  const speaker = openSpeaker(context, chirp);
  const firstFrame = Math.ceil((context.currentTime + delayS) * rateHz);
  let schedule = initialSchedule(parameters);
  let slot = 0;

  const playDue = () => {
    const now = context.currentTime * rateHz;
    const until = now + aheadS(schedule.alone >= parameters.forget) * rateHz;
    for (;; slot += 1) {
      const start = firstFrame + slot * period + Math.round(schedule.shiftS * rateHz);
      if (start >= until) return;
      const frame = start + Math.floor(chance() * parameters.jitter_s * rateHz);
      const isOurs = isPlayed(schedule, slot, chance(), parameters) && frame > now;
      const gainDb = chance() < 0.5 ? -(parameters.softer_db ?? 0) : 0;
      if (isOurs) speaker.play(frame, gainDb);
      tell({ slot, start, played: isOurs ? frame : null, gainDb });
    }
  };

  playDue();
  const timer = setInterval(playDue, EVERY_MS);
  const stop = () => {
    clearInterval(timer);
    return speaker.stop();
  };
  /** @param {number} at the slot @param {number[]} othersS @param {boolean} played */
  const heard = (at, othersS, played) => {
    schedule = afterSlot(schedule, at, othersS, played, chance(), parameters);
  };
  return { heard, stop };
}

/** @param {boolean} isAlone */
function aheadS(isAlone) {
  if (document.hidden) return AHEAD_S;
  return isAlone ? SEEN_AHEAD_S : AMONG_OTHERS_AHEAD_S;
}

/** Uniform in [0, 1), and nobody can foresee it. */
function chance() {
  return crypto.getRandomValues(new Uint32Array(1))[0] / 2 ** 32;
}

/**
 * play: puts a chirp on a frame of the clock, so loud (dB); stop: calls back those that do not sound yet.
 * @param {AudioContext} context @param {Float32Array<ArrayBuffer>} chirp
 */
function openSpeaker(context, chirp) {
  const buffer = context.createBuffer(1, chirp.length, context.sampleRate);
  buffer.copyToChannel(chirp, 0);
  const gain = new GainNode(context, { gain: LEVEL });
  gain.connect(context.destination);
  /** @type {Map<AudioBufferSourceNode, number>} */
  const due = new Map();
  /** @param {number} frame */
  const play = (frame, gainDb = 0) => {
    const source = new AudioBufferSourceNode(context, { buffer });
    const softer = new GainNode(context, { gain: 10 ** (gainDb / 20) });
    source.connect(softer).connect(gain);
    source.onended = () => {
      due.delete(source);
      softer.disconnect();
    };
    source.start(frame / context.sampleRate);
    due.set(source, frame);
  };
  const stop = () => {
    const limit = (context.currentTime + MARGIN_S) * context.sampleRate;
    due.forEach((frame, source) => frame > limit && source.stop());
    return limit;
  };
  return { play, stop };
}

/** Microphone, loudspeaker and motion of this phone, as walking and locating share them. */

import { excitationOf, periodSamples } from "../stages/chirp.js";
import { watchClocks } from "./clocks.js";
import { keptChoice, openMicrophone } from "./microphone.js";
import { allowMotion } from "./motion.js";
import { startChirps, startSlots } from "./player.js";

/**
 * @typedef {{
 *   microphone: import("./microphone.js").Microphone, sound: Sound,
 *   clocks: ReturnType<typeof watchClocks>, isMotionAllowed: boolean,
 *   play: (delayS: number, count?: number) => ReturnType<typeof startChirps>,
 *   playSlots: (delayS: number, tell: (slot: {slot: number, start: number, played: number | null,
 *     gainDb: number}) => void,
 *     parameters?: import("../stages/medium_access.js").MediumAccessParameters) => ReturnType<typeof startSlots>,
 * }} Devices
 */

/**
 * Must be called from a tap. Raises Problem.
 * @param {import("./storage_client.js").StorageClient} storage @param {import("../stages/chirp.js").Chirp} chirp
 * @param {import("../stages/medium_access.js").MediumAccessParameters} mediumAccess as the server takes them
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

/** Microphone, loudspeaker and motion of this phone, as walking and locating share them. */

import { excitationOf, periodSamples } from "../stages/chirp.js";
import { watchClocks } from "./clocks.js";
import { openMicrophone } from "./microphone.js";
import { keptChoice } from "./microphones.js";
import { allowMotion } from "./motion_sensor.js";
import { startChirps, startSlots } from "./player.js";
import { startSound } from "./sound.js";

/**
 * @typedef {{
 *   microphone: import("./microphone.js").Microphone, sound: import("./sound.js").Sound,
 *   clocks: ReturnType<typeof watchClocks>, isMotionAllowed: boolean,
 *   play: (delayS: number, count?: number) => ReturnType<typeof startChirps>,
 *   playSlots: (delayS: number, tell: (slot: {slot: number, start: number, played: number | null,
 *     gainDb: number}) => void,
 *     parameters?: import("../stages/medium_access.js").MediumAccessParameters) => ReturnType<typeof startSlots>,
 * }} Devices
 */

/**
 * Must be called from a tap. Raises Problem.
 * @param {import("./keeper.js").Keeper} keeper @param {import("../stages/chirp.js").Chirp} chirp
 * @param {import("../stages/medium_access.js").MediumAccessParameters} mediumAccess as the server takes them
 * @returns {Promise<Devices>}
 */
export async function openDevices(keeper, chirp, mediumAccess) {
  const motion = allowMotion();
  const microphone = await openMicrophone(keptChoice()?.chosen);
  const isMotionAllowed = await motion;
  const sound = startSound(microphone, keeper, chirp);
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

/** Microphone, loudspeaker and motion of this phone, as walking and locating share them. */

import { makeChirp, periodSamples } from "./chirp.js";
import { openMicrophone } from "./microphone.js";
import { allowMotion } from "./motion_sensor.js";
import { startChirps } from "./player.js";
import { startSound } from "./sound.js";
import { watchClocks } from "./walking.js";

/**
 * @typedef {{
 *   microphone: import("./microphone.js").Microphone, sound: import("./sound.js").Sound,
 *   clocks: ReturnType<typeof watchClocks>, isMotionAllowed: boolean,
 *   play: (delayS: number, count?: number, schedule?: {jitterS?: number, onPlayed?: (frame: number) => void}) => ReturnType<typeof startChirps>,
 * }} Devices
 */

/**
 * Must be called from a tap. Raises Problem.
 * @param {import("./keeper.js").Keeper} keeper @param {import("./chirp.js").Chirp} chirp
 * @returns {Promise<Devices>}
 */
export async function openDevices(keeper, chirp) {
  const motion = allowMotion();
  const microphone = await openMicrophone();
  const isMotionAllowed = await motion;
  const sound = startSound(microphone, keeper, chirp);
  const rateHz = microphone.context.sampleRate;
  const samples = makeChirp(chirp, rateHz);
  const period = periodSamples(chirp, rateHz);
  const play = (delayS, count, schedule) => startChirps(microphone.context, samples, period, delayS, count, schedule);
  return { microphone, sound, play, clocks: watchClocks(microphone.context), isMotionAllowed };
}

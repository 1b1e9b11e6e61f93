/** The page's side of the sound's worker: orders, answers that are waited for, and frames as they come. */

/**
 * @typedef {{
 *   order: (order: object, transfer?: Transferable[]) => void,
 *   answer: (kind: string) => Promise<any>,
 *   on: (kind: string, heard: (news: any) => void) => void,
 * }} Sound
 */

/**
 * @param {import("./microphone.js").Microphone} microphone
 * @param {import("./keeper.js").Keeper} keeper
 * @param {import("../stages/chirp.js").Chirp} chirp
 * @returns {Sound}
 */
export function startSound(microphone, keeper, chirp) {
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
  const store = keeper.port();
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

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
 * @param {import("./chirp.js").Chirp} chirp
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

const QUIET_S = 0.6;
const PROBE_CHIRPS = 20;
const TAIL_S = 0.4;

/**
 * Plays two seconds of chirps after a moment of silence, and measures what comes back.
 * @param {Sound} sound
 * @param {(delayS: number, count: number) => {firstFrame: number}} play
 * @param {number} periodS
 * @returns {Promise<import("./probe.js").Measured>}
 */
export async function probeSound(sound, play, periodS) {
  sound.order({ do: "listen" });
  const { firstFrame } = play(QUIET_S, PROBE_CHIRPS);
  await new Promise((resolve) => {
    setTimeout(resolve, 1000 * (QUIET_S + PROBE_CHIRPS * periodS + TAIL_S));
  });
  const measured = sound.answer("measured");
  sound.order({ do: "measure", due: firstFrame, count: PROBE_CHIRPS });
  return (await measured).measured;
}

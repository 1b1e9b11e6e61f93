/** Where the phone is, as sound and motion come in. Only the encoder takes its time; nothing else waits. */

import { makeMeanNormalisation } from "../../stages/encoder.js";

/** So long a fix waits for echoes: a cutter that has to find the chirps anew gives them late. */
const PATIENCE_S = 1.5;
/** Traces that go through the encoder together, where several wait. */
const MOST_AT_ONCE = 32;
const TRACE = 2352;

/**
 * @template Answer a fix, or whatever else is made of what was heard
 * @param {{
 *   rateHz: number,
 *   cutter: import("../../stages/echo.js").EchoCutter,
 *   listener: {embed: (samples: Float32Array, n: number) => Promise<Float32Array>},
 *   clean?: (echoes: import("../../stages/echo.js").Echo[]) => import("../../stages/echo.js").Echo[],
 *   spoofing?: {take: (facts: import("../../stages/spoofing.js").Facts[], echoes: import("../../stages/echo.js").Echo[],
 *     clean: import("../../stages/echo.js").Echo[]) => void},
 *   memory: ReturnType<typeof import("./memory.js").makeMemory>,
 *   deciding: {decide: (untilS: number) => Answer[]},
 *   onFix: (answer: Answer) => void,
 *   onEcho?: (echo: import("../../stages/echo.js").Echo) => void,
 * }} given clean: keeps back the echoes that others have spoiled
 * @returns {{push: (first: number, samples: Float32Array) => Promise<void>, idle: () => Promise<void>}}
 */
export function makePlacer({ rateHz, cutter, clean = same, listener, spoofing, memory, deciding, onFix, onEcho = () => {} }) {
  /** @type {import("../../stages/echo.js").Echo[]} */
  let waiting = [];
  let heardS = 0;
  let echoedS = -Infinity;
  const normalised = makeMeanNormalisation();
  let working = Promise.resolve();
  let isWorking = false;

  const embedSome = async () => {
    const echoes = waiting.slice(0, MOST_AT_ONCE);
    waiting = waiting.slice(echoes.length);
    const samples = new Float32Array(echoes.length * TRACE);
    echoes.forEach((echo, k) => samples.set(echo.samples, k * TRACE));
    const vectors = normalised(await listener.embed(samples, echoes.length));
    memory.add(echoes.map(({ tS }) => tS), vectors);
    echoedS = echoes[echoes.length - 1].tS;
  };

  const work = async () => {
    do {
      const longAgoS = heardS - PATIENCE_S;
      while (waiting.length > 0) await embedSome();
      deciding.decide(Math.max(longAgoS, echoedS)).forEach(onFix);
    } while (waiting.length > 0);
  };

  /** @param {number} first @param {Float32Array} samples */
  const push = (first, samples) => {
    const echoes = cutter.push(first, samples);
    const kept = clean(echoes);
    spoofing?.take(cutter.frames(), echoes, kept);
    heardS = (first + samples.length) / rateHz;
    echoes.forEach(onEcho);
    waiting.push(...kept);
    if (!isWorking) {
      isWorking = true;
      working = work().finally(() => {
        isWorking = false;
      });
    }
    return working;
  };

  return { push, idle: () => working };
}

/** @param {import("../../stages/echo.js").Echo[]} echoes */
function same(echoes) {
  return echoes;
}

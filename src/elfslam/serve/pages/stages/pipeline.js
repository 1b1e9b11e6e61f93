/**
 * The stages put together on the phone: sound and motion come in, echoes are cut and embedded, and whoever decides makes
 * something of them. The worker that locates and the one that draws a growing map run the same pipeline.
 */

import { ECHO_SAMPLES, ELF_SIZE } from "./constants.js";
import { makeChirp } from "./chirp.js";
import { makeEchoCutter } from "./echo.js";
import { makeMeanNormalisation } from "./encoder.js";
import { meanOf } from "./locate.js";
import { makeFootsteps } from "./motion/live.js";
import { hearOthers } from "./spoiled.js";

/**
 * @typedef {ReturnType<typeof makeMemory>} Memory
 * @typedef {ReturnType<typeof makeFootsteps>} Footsteps
 */

/**
 * @template Answer
 * @param {{
 *   rateHz: number,
 *   parameters: Pick<import("./floor_map.js").MapParameters, "chirp" | "echo" | "medium_access" | "motion">
 *     & {locate: {fewest_echoes: number}},
 *   listener: {embed: (samples: Float32Array, n: number) => Promise<Float32Array>},
 *   decide: (memory: Memory, footsteps: Footsteps) => {decide: (untilS: number) => Answer[]},
 *   onFix: (answer: Answer) => void,
 *   onEcho?: (echo: import("./echo.js").Echo) => void,
 *   onHeard?: (heard: import("./hearing.js").Heard) => void,
 *   spoofing?: Parameters<typeof makePlacer>[0]["spoofing"],
 * }} given onHeard: told of other phones in the slots that are over
 */
export function openPipeline({ rateHz, parameters, listener, decide, onFix, onEcho, onHeard = () => {}, spoofing }) {
  const cutter = makeEchoCutter({ rateHz, chirp: makeChirp(parameters.chirp, rateHz), parameters });
  const others = hearOthers(cutter, parameters.chirp.period_s, parameters.medium_access);
  const memory = makeMemory(parameters.locate.fewest_echoes);
  const footsteps = makeFootsteps(parameters.motion);
  const motion = delayMotion(footsteps, cutter.latenessS);
  const deciding = decide(memory, footsteps);
  const { clean } = others;
  const placer = makePlacer({ rateHz, cutter, clean, listener, spoofing, memory, deciding, onFix, onEcho });
  return {
    /** The next samples; done when all that they settle is told. @param {number} first @param {Float32Array} samples */
    push(first, samples) {
      const done = placer.push(first, samples);
      others.take().forEach(onHeard);
      return done;
    },
    motion: motion.push,
    /** A slot of our turns, as it is played. @param {import("./spoiled.js").Slot & {gainDb: number}} slot */
    slot(slot) {
      others.add(slot);
      if (slot.playedS !== null) cutter.played(slot.playedS, slot.gainDb);
    },
    latenessS: cutter.latenessS,
  };
}

// Echoes, embedded and decided on: only the encoder takes its time; nothing else waits.

/** So long a fix waits for echoes: a cutter that has to find the chirps anew gives them late. */
const ECHO_PATIENCE_S = 1.5;
/** Traces that go through the encoder together, where several wait. */
const MOST_AT_ONCE = 32;

/**
 * @template Answer a fix, or whatever else is made of what was heard
 * @param {{
 *   rateHz: number,
 *   cutter: import("./echo.js").EchoCutter,
 *   listener: {embed: (samples: Float32Array, n: number) => Promise<Float32Array>},
 *   clean?: (echoes: import("./echo.js").Echo[]) => import("./echo.js").Echo[],
 *   spoofing?: {take: (facts: import("./spoofing.js").Facts[], echoes: import("./echo.js").Echo[],
 *     clean: import("./echo.js").Echo[]) => void},
 *   memory: ReturnType<typeof makeMemory>,
 *   deciding: {decide: (untilS: number) => Answer[]},
 *   onFix: (answer: Answer) => void,
 *   onEcho?: (echo: import("./echo.js").Echo) => void,
 * }} given clean: keeps back the echoes that others have spoiled
 * @returns {{push: (first: number, samples: Float32Array) => Promise<void>, idle: () => Promise<void>}}
 */
export function makePlacer({ rateHz, cutter, clean = same, listener, spoofing, memory, deciding, onFix, onEcho = () => {} }) {
  /** @type {import("./echo.js").Echo[]} */
  let waiting = [];
  let heardS = 0;
  let echoedS = -Infinity;
  const normalised = makeMeanNormalisation();
  let working = Promise.resolve();
  let isWorking = false;

  const embedSome = async () => {
    const echoes = waiting.slice(0, MOST_AT_ONCE);
    waiting = waiting.slice(echoes.length);
    const samples = new Float32Array(echoes.length * ECHO_SAMPLES);
    echoes.forEach((echo, k) => samples.set(echo.samples, k * ECHO_SAMPLES));
    const vectors = normalised(await listener.embed(samples, echoes.length));
    memory.add(echoes.map(({ tS }) => tS), vectors);
    echoedS = echoes[echoes.length - 1].tS;
  };

  const work = async () => {
    do {
      const longAgoS = heardS - ECHO_PATIENCE_S;
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

/** @param {import("./echo.js").Echo[]} echoes */
function same(echoes) {
  return echoes;
}

// Motion, held back until it is known how long sound takes, and then moved beside the sound. Pure.

/** Without a chirp by then, motion is timed as if sound took no time. */
const MOTION_PATIENCE_S = 3;

/**
 * @typedef {{tS: number, acceleration: number[] | null, turning: number[] | null}} Reading tS: of the
 *   sound that was being played
 */

/**
 * @param {{push: (tS: number, acceleration: number[], turning: number[]) => void}} footsteps
 * @param {() => number | null} latenessS
 * @returns {{push: (readings: Reading[]) => void}}
 */
export function delayMotion(footsteps, latenessS) {
  /** @type {Reading[]} */
  let waiting = [];
  let lastS = -Infinity;
  const pass = (/** @type {number} */ lateS) => {
    for (const { tS, acceleration, turning } of waiting) {
      if (!acceleration || !turning || tS + lateS <= lastS) continue;
      lastS = tS + lateS;
      footsteps.push(lastS, acceleration, turning);
    }
    waiting = [];
  };
  const push = (/** @type {Reading[]} */ readings) => {
    waiting.push(...readings);
    const lateS = latenessS();
    const isTooLong = waiting.length > 0 && waiting[waiting.length - 1].tS - waiting[0].tS > MOTION_PATIENCE_S;
    if (lateS !== null || isTooLong) pass(lateS ?? 0);
  };
  return { push };
}

// What was heard lately: a unit vector per echo, until a fix has been made of it. Pure.

/**
 * @param {number} fewest echoes that make a mean
 * @returns {{
 *   add: (tS: number[], vectors: Float32Array) => void,
 *   count: (fromS: number, toS: number) => number,
 *   mean: (fromS: number, toS: number) => Float32Array | null,
 *   alike: (fromS: number, toS: number) => number[],
 *   forget: (beforeS: number) => void,
 *   firstS: () => number | null,
 * }} times are those of direct arrivals; from the first to before the second; alike: cosines of successive echoes
 */
export function makeMemory(fewest) {
  /** @type {{tS: number, vector: Float32Array}[]} */
  let rows = [];
  /** @param {number} fromS @param {number} toS */
  const between = (fromS, toS) => rows.filter(({ tS }) => tS >= fromS && tS < toS);
  return {
    add(times, vectors) {
      times.forEach((tS, k) => rows.push({ tS, vector: vectors.slice(k * ELF_SIZE, (k + 1) * ELF_SIZE) }));
    },
    count: (fromS, toS) => between(fromS, toS).length,
    mean(fromS, toS) {
      const found = between(fromS, toS);
      if (found.length < fewest) return null;
      const together = new Float32Array(found.length * ELF_SIZE);
      found.forEach(({ vector }, k) => together.set(vector, k * ELF_SIZE));
      return meanOf(together, 0, found.length);
    },
    alike(fromS, toS) {
      const found = between(fromS, toS);
      return found.slice(1).map(({ vector }, k) => vector.reduce((sum, each, d) => sum + each * found[k].vector[d], 0));
    },
    forget(beforeS) {
      rows = rows.filter(({ tS }) => tS >= beforeS);
    },
    firstS: () => rows[0]?.tS ?? null,
  };
}

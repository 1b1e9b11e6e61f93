/** Locating, as the page does it: chirps go out, sound and motion go to a worker, fixes come back. */

import { listenToMotion } from "../motion.js";
import { soundTime } from "../clocks.js";
import { t, translated } from "../../shared/words.js";

const MOTION_EVERY_MS = 150;
const FIRST_CHIRP_S = 0.25;
const SAME_S = 0.01;
const TOO_OLD = t("This browser cannot run the part of the page that locates. Use a newer one.");

/**
 * @typedef {{
 *   fix: (fix: import("./words.js").Fix) => void,
 *   echo: (echo: {tS: number, facts: object}) => void,
 *   problem: (said: string) => void,
 * }} Told
 * @typedef {import("../../stages/floor_location.js").Floor} Floor
 * @typedef {{latenessS: number | null, playedS: number[], unheeded: number,
 *   heard: (slot: number, othersS: number[], played: boolean) => void}} Latest unheeded: what the walker said
 *   and the worker does not know yet
 */

/**
 * @param {import("../devices.js").Devices} devices
 * @param {{floorMap: import("../../stages/floor_map.js").FloorMap, encoderBytes: Uint8Array<ArrayBuffer>}} kept
 * @param {number | undefined} level of it, where other floors are to join
 * @param {"track" | "one-shot"} mode
 * @param {Told} told
 * @returns {Promise<{stop: () => void, zeroS: () => number, nowS: () => number,
 *   playedUntil: (heardS: number) => number, join: (floors: Floor[]) => void, say: (floor: Floor | null) => void}>}
 *   zeroS: when, on the clock of the fixes, the first chirp was heard; nowS: what that clock shows now; playedUntil: how
 *   many should have been heard; join: takes the maps of the other floors; say: where the walker says that they are
 */
export async function startPlacing({ microphone, clocks, playSlots }, { floorMap, encoderBytes }, level, mode, told) {
  const worker = new Worker(new URL("./place.worker.js", import.meta.url), { type: "module" });
  const { port1, port2 } = new MessageChannel();
  const rateHz = microphone.context.sampleRate;
  /** @type {Latest} */
  const latest = { latenessS: null, playedS: [], unheeded: 0, heard: () => {} };
  const ready = untilReady(worker, told, latest);
  worker.postMessage({ do: "open", rateHz, level, floorMap, encoderBytes, mode, source: port1 }, [port1]);
  try {
    await ready;
  } catch (error) {
    worker.terminate();
    throw error;
  }
  const stopMotion = sendMotion(worker, clocks);
  const chirps = playSlots(FIRST_CHIRP_S, ({ slot, start, played, gainDb }) => {
    const playedS = played === null ? null : played / rateHz;
    if (playedS !== null) latest.playedS.push(playedS);
    worker.postMessage({ do: "slot", slot: { slot, startS: start / rateHz, playedS, gainDb } });
  }, floorMap.parameters.medium_access);
  latest.heard = chirps.heard;
  microphone.pour("place", port2); // the schedule first, then what is heard
  const stop = () => {
    chirps.stop();
    stopMotion();
    microphone.pour("place", null);
    worker.terminate();
  };
  const lateS = () => latest.latenessS ?? 0;
  return {
    stop,
    join: (floors) => worker.postMessage({ do: "join", floors }, floors.flatMap(({ floorMap: joining }) => buffersOf(joining))),
    say(floor) {
      latest.unheeded += 1;
      worker.postMessage({ do: "say", floor });
    },
    zeroS: () => (latest.playedS[0] ?? 0) + lateS(),
    nowS: () => soundTime(clocks.line(), performance.now()) + lateS(),
    playedUntil: (heardS) => latest.playedS.filter((playedS) => playedS + lateS() < heardS + SAME_S).length,
  };
}

/** Of all that a map holds. @param {object} floorMap @returns {ArrayBufferLike[]} */
function buffersOf(floorMap) {
  return Object.values(floorMap).filter(ArrayBuffer.isView).map(({ buffer }) => buffer);
}

/** @param {Worker} worker @param {Told} told @param {Latest} latest @returns {Promise<void>} */
function untilReady(worker, told, latest) {
  return new Promise((resolve, reject) => {
    worker.onerror = () => reject(new Error(TOO_OLD));
    worker.onmessage = ({ data }) => {
      if (data.is === "ready") resolve();
      if (data.is === "said") latest.unheeded -= 1;
      if (data.is === "fix" && latest.unheeded === 0) told.fix(data.fix);
      if (data.is === "echo") {
        latest.latenessS = data.latenessS;
        told.echo(data);
      }
      if (data.is === "heard") latest.heard(data.slot, data.othersS, data.played);
      if (data.is === "problem") {
        reject(new Error(translated(data.said)));
        told.problem(translated(data.said));
      }
    };
  });
}

/**
 * Every reading with the time of the sound that was being played.
 * @param {Worker} worker @param {import("../devices.js").Devices["clocks"]} clocks @returns {() => void} stops
 */
export function sendMotion(worker, clocks) {
  /** @type {{pageMs: number, acceleration: number[] | null, turning: number[] | null}[]} */
  let readings = [];
  const stop = listenToMotion((pageMs, acceleration, turning) => readings.push({ pageMs, acceleration, turning }));
  const timer = setInterval(() => {
    const line = clocks.line();
    const timed = readings.map(({ pageMs, ...values }) => ({ tS: soundTime(line, pageMs), ...values }));
    readings = [];
    worker.postMessage({ do: "motion", readings: timed });
  }, MOTION_EVERY_MS);
  return () => {
    stop();
    clearInterval(timer);
  };
}

/** Hears other phones in the slots of our turns, by the envelope that the echoes are cut by. */

import { ECHO_RATE_HZ } from "../../stages/resample.js";
import { makeSpoiled } from "../../stages/spoiled.js";
import { makeHearing } from "../hearing.js";

/**
 * @typedef {{slot: number, startS: number, playedS: number | null}} Slot when it starts, and when the own
 *   chirp in it is played
 */

/**
 * @param {import("../../stages/echo.js").EchoCutter} cutter
 * @param {number} periodS
 * @param {import("../../stages/medium_access.js").MediumAccessParameters} parameters
 * @returns {{add: (slot: Slot) => void, take: () => import("../hearing.js").Heard[],
 *   clean: (echoes: import("../../stages/echo.js").Echo[]) => import("../../stages/echo.js").Echo[]}} take: what
 *   was heard in the slots that are over; after the first sound only. clean: echoes without those that others
 *   have spoiled, as long as others are about
 */
export function hearOthers({ heard }, periodS, parameters) {
  const hearing = makeHearing(ECHO_RATE_HZ, Math.round(periodS * ECHO_RATE_HZ), parameters);
  const spoiled = makeSpoiled(heard, parameters);
  /** @type {Slot[]} */
  let waiting = [];
  let alone = parameters.forget;
  const take = () => {
    for (const { slot, startS, playedS } of waiting) {
      const played = playedS === null ? null : heard.sampleAt(playedS);
      hearing.add({ slot, start: heard.sampleAt(startS), played });
    }
    waiting = [];
    const found = hearing.take(heard);
    for (const { othersS } of found) alone = othersS.length > 0 ? 0 : alone + 1;
    return found;
  };
  const clean = (/** @type {import("../../stages/echo.js").Echo[]} */ echoes) => spoiled.take(echoes, alone < parameters.forget);
  return { add: (slot) => waiting.push(slot), take, clean };
}

/** Hears others in the slots of our turns, as the stream goes on. */

import { NOTHING_HEARD, hearSlot } from "../line/listening.js";

const ECHO_RATE_HZ = 44100;
/** Of the sound around a slot: what was not listened to yet, and what may still come. */
const BEFORE_S = 0.15;
const BEHIND_S = 0.05;

/**
 * @typedef {{slot: number, start: number, played: number | null}} Told samples of the stream as they were
 *   played, not yet heard
 * @typedef {{slot: number, othersS: number[], played: boolean}} Heard others' chirps, from the middle of
 *   where the own would be played
 */

/**
 * @param {number} rateHz @param {number} period samples
 * @param {import("../line/turns.js").TurnsParameters} parameters
 * @returns {{add: (told: Told) => void, take: (framer: import("./framer.js").Framer) => Heard[]}}
 */
export function makeHearing(rateHz, period, parameters) {
  const waiting = [];
  let listening = NOTHING_HEARD;
  const scale = ECHO_RATE_HZ / rateHz;
  const onLine = (sample) => (sample === null ? null : Math.round(sample * scale));

  const hear = (framer, told, next) => {
    const late = framer.late();
    const start = told.start + late;
    const from = Math.max(start - Math.round(BEFORE_S * rateHz), 0);
    const envelope = atEchoRate(framer.envelope(from, start + period + Math.round(BEHIND_S * rateHz)), rateHz);
    const heard = (sample) => (sample === null ? null : onLine(sample + late));
    const slot = {
      start: onLine(start), end: onLine(start + period), due: heard(told.played), following: heard(next.played),
    };
    const found = hearSlot(listening, envelope, onLine(from), slot, parameters);
    listening = found.listening;
    const middle = slot.start + Math.round((parameters.jitter_s / 2) * ECHO_RATE_HZ);
    const othersS = found.others.map((sample) => (sample - middle) / ECHO_RATE_HZ);
    return { slot: told.slot, othersS, played: told.played !== null };
  };

  const take = (framer) => {
    const heard = [];
    const reach = period + Math.round(2 * BEHIND_S * rateHz);
    while (waiting.length > 1 && framer.late() !== null) {
      if (framer.end() < waiting[0].start + framer.late() + reach) break;
      heard.push(hear(framer, waiting.shift(), waiting[0]));
    }
    return heard;
  };

  return { add: (told) => waiting.push(told), take };
}

/** The larger of the two samples about each of 44.1 kHz. */
function atEchoRate(envelope, rateHz) {
  if (rateHz === ECHO_RATE_HZ) return envelope;
  const step = rateHz / ECHO_RATE_HZ;
  return Float32Array.from({ length: Math.floor((envelope.length - 1) / step) }, (_, n) => {
    const k = Math.floor(n * step);
    return Math.max(envelope[k], envelope[k + 1]);
  });
}

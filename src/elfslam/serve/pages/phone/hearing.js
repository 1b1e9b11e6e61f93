/** Hears others in the slots of our turns, as the stream goes on. */

import { NOTHING_HEARD, hearSlot } from "../stages/listening.js";

const ECHO_RATE_HZ = 44100;
/** Of the sound around a slot: what was not listened to yet, and what may still come. */
const BEFORE_S = 0.15;
const BEHIND_S = 0.05;
/** Samples about an own arrival, at 44.1 kHz. */
const NEAR = 88;
/** Within this the time from playing to hearing counts as the same: browsers that correct a clock cut out 0.3 ms. */
const ALIKE_S = 0.00015;

/**
 * @typedef {{slot: number, start: number, played: number | null}} Told samples of the stream as they were
 *   played, not yet heard
 * @typedef {{slot: number, othersS: number[], played: boolean}} Heard others' chirps, from the middle of
 *   where the own would be played
 */

/**
 * @typedef {{envelope: (from: number, to: number) => Float32Array, end: () => number,
 *   late: (sample: number) => number | null | undefined}} HeardSound the envelope of the last seconds; late:
 *   how late what is played at a sample is heard, undefined where that is not settled yet and null where
 *   nobody will know
 */

/**
 * @param {number} rateHz @param {number} period samples
 * @param {import("../stages/medium_access.js").MediumAccessParameters} parameters
 * @returns {{add: (told: Told) => void, take: (sound: HeardSound) => Heard[]}} take: what was heard in the
 *   slots that are over; of those where own chirps cannot be told from others', or that began before the
 *   stream, nothing is said. Nor of those about a stall of the sound: it may tear an own chirp in two, and
 *   what the matched filter makes of the halves is heard where no own one is due
 */
export function makeHearing(rateHz, period, parameters) {
  /** @type {Told[]} */
  const waiting = [];
  let listening = NOTHING_HEARD;
  /** How late the last slot was heard. @type {number | null} */
  let before = null;
  const scale = ECHO_RATE_HZ / rateHz;
  /** @param {number} sample */
  const onLine = (sample) => Math.round(sample * scale);
  const reach = period + Math.round(2 * BEHIND_S * rateHz);

  /**
   * What was heard in a slot that is over; of both slots it is known how late they are heard.
   * @param {HeardSound} sound @param {Told} told @param {Told} next @returns {Heard}
   */
  const hear = (sound, told, next) => {
    const start = told.start + /** @type {number} */ (sound.late(told.played ?? told.start));
    const from = Math.max(start - Math.round(BEFORE_S * rateHz), 0);
    const envelope = atEchoRate(sound.envelope(from, start + period + Math.round(BEHIND_S * rateHz)), rateHz);
    // Where sound comes later than was guessed, what lies between was not listened to.
    if (listening.until !== null) listening = { ...listening, until: Math.max(listening.until, onLine(from)) };
    /** @param {number | null} sample */
    const heard = (sample) =>
      sample === null ? null : onLine(sample + /** @type {number} */ (sound.late(sample)));
    const slot = {
      start: onLine(start), end: onLine(start + period), due: heard(told.played), following: heard(next.played),
    };
    if (listening.direct === 0) listening = { ...listening, direct: levelOf(envelope, slot, onLine(from)) };
    const found = hearSlot(listening, envelope, onLine(from), slot, parameters);
    listening = found.listening;
    const middle = slot.start + Math.round((parameters.jitter_s / 2) * ECHO_RATE_HZ);
    const othersS = found.others.map((sample) => (sample - middle) / ECHO_RATE_HZ);
    return { slot: told.slot, othersS, played: told.played !== null };
  };

  /** How late both slots are heard; undefined where it is too early to say. @param {HeardSound} sound */
  const lateBoth = (sound) => {
    const [told, next] = waiting.map(({ start, played }) => played ?? start);
    const both = [sound.late(told), sound.late(next)];
    // Where nobody will know, null counts as 0.
    const isOver = () => sound.end() >= waiting[0].start + Math.max(.../** @type {number[]} */ (both)) + reach;
    return both.includes(undefined) || !isOver() ? undefined : both;
  };

  /** @param {(number | null | undefined)[]} late */
  const jumps = (late) => {
    const known = late.flatMap((each) => each ?? []);
    return Math.max(...known) - Math.min(...known) > ALIKE_S * rateHz;
  };

  /** @param {HeardSound} sound */
  const take = (sound) => {
    /** @type {Heard[]} */
    const heard = [];
    while (waiting.length > 1) {
      const both = lateBoth(sound);
      if (both === undefined) break;
      const told = /** @type {Told} */ (waiting.shift());
      // What was heard before the stream began is not known either.
      const isBefore = (told.played ?? told.start) + /** @type {number} */ (both[0]) < 0;
      const isUnknown = isBefore || both.includes(null) || jumps([before ?? both[0], ...both]);
      before = both[0] ?? null;
      if (isUnknown) listening = { ...listening, until: null };
      else heard.push(hear(sound, told, waiting[0]));
    }
    return heard;
  };

  return { add: (told) => waiting.push(told), take };
}

/**
 * How loud the first own chirp is, in a slot or behind it: it is heard a little before it comes, too.
 * @param {Float32Array} envelope @param {import("../stages/listening.js").Slot} slot @param {number} first
 */
function levelOf(envelope, { due, following }, first) {
  const at = due ?? following;
  return at === null ? 0 : envelope.slice(Math.max(at - first - NEAR, 0), at - first + NEAR).reduce((a, b) => Math.max(a, b), 0);
}

/** The larger of the two samples about each of 44.1 kHz. @param {Float32Array} envelope @param {number} rateHz */
function atEchoRate(envelope, rateHz) {
  if (rateHz === ECHO_RATE_HZ) return envelope;
  const step = rateHz / ECHO_RATE_HZ;
  return Float32Array.from({ length: Math.floor((envelope.length - 1) / step) }, (_, n) => {
    const k = Math.floor(n * step);
    return Math.max(envelope[k], envelope[k + 1]);
  });
}

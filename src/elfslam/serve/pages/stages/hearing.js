/** Hears others in the slots of our turns, as the stream goes on. */

import { ECHO_RATE_HZ, FOREIGN, LISTENING } from "./constants.js";

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
 * @param {MediumAccessParameters} parameters
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
 * @param {Float32Array} envelope @param {Slot} slot @param {number} first
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

// Slot by slot: when other phones chirped, by the rules of elfslam.stages.medium_access. Before an own direct
// arrival and once its echoes are over nothing of ours is heard: what is loud there is somebody else's.

/**
 * BIN: samples of the envelope of which the largest stands for all; in bins, GUARD: before a direct arrival the matched
 * filter hears it already, DIRECT: behind it nothing else is heard, LULL: behind it its echoes are over, SAME: another's
 * chirp echoes.
 */
const { BIN, DIRECT, FADES, GUARD, LOUDEST_ECHO, LULL, SAME } = FOREIGN;
/** LATE: what is heard later than that behind the beginning of a slot belongs to the next. LOST: a stretch more silent
 * than that beside the own direct sound was lost, and tells of no noise. */
const { LATE, LOST, NOISE, REMEMBERED, SLACK, STRETCHES } = LISTENING;

/**
 * What was heard so far; samples are those of a line at 44.1 kHz.
 * @typedef {{direct: number, until: number | null, limit: number, others: Beginning[],
 *   noises: number[]}} Listening
 * @typedef {Listening & {until: number}} Begun
 * @typedef {{start: number, end: number, due: number | null, following: number | null}} Slot
 * @typedef {[number, number]} Beginning bin or sample of another's chirp, and its level
 */

/** @type {Listening} */
export const NOTHING_HEARD = { direct: 0, until: null, limit: 0, others: [], noises: [] };

/**
 * Samples at which others' chirps arrived in a slot, where the own one leaves silence.
 * @param {Listening} listening
 * @param {Float32Array} envelope of the matched filter, beginning at sample `first`
 * @param {number} first @param {Slot} slot @param {MediumAccessParameters} parameters
 * @returns {{others: number[], listening: Listening}}
 */
export function hearSlot(listening, envelope, first, slot, parameters) {
  let now = /** @type {Begun} */ (listening.until === null ? { ...listening, until: slot.start } : listening);
  if (slot.due !== null) {
    const arrival = arrivalIn(envelope, slot.due - first) + first;
    now = { ...now, direct: envelope[arrival - first] };
    now = inSilence(now, envelope, first, arrival - GUARD * BIN, parameters);
    now = { ...now, until: arrival + LULL * BIN };
  }
  const end = slot.following === null ? slot.end : slot.following - SLACK - GUARD * BIN;
  now = inSilence(now, envelope, first, Math.min(end, slot.end), parameters);
  const limit = slot.start + LATE;
  const here = now.others.map(([sample]) => sample).filter((each) => listening.limit <= each && each < limit);
  return { others: here, listening: { ...now, limit } };
}

/**
 * Listens up to a sample; nothing of ours is heard until then.
 * @param {Begun} now @param {Float32Array} envelope @param {number} first @param {number} end
 * @param {MediumAccessParameters} parameters @returns {Begun}
 */
function inSilence(now, envelope, first, end, parameters) {
  const begin = now.until;
  const bins = pooled(envelope, begin - first, Math.floor((end - begin) / BIN));
  if (bins.length === 0) return now;
  const level = middle(bins);
  const noises = level > LOST * now.direct ? [...now.noises, level].slice(-STRETCHES) : now.noises;
  const least = Math.max(parameters.share * now.direct, noises.length > 0 ? NOISE * Math.min(...noises) : 0);
  /** @type {Beginning[]} */
  const before = now.others.map(([sample, level]) => [Math.floor((sample - begin) / BIN), level]);
  /** @type {Beginning[]} */
  const found = beginnings(bins, least, before).map(([k, level]) => [begin + k * BIN, level]);
  const others = [...now.others, ...found].slice(-REMEMBERED);
  return { ...now, until: begin + bins.length * BIN, others, noises };
}

/**
 * The largest of every 16 samples from `first` on; zero beyond the ends.
 * @param {Float32Array} envelope @param {number} first @param {number} count of bins
 */
export function pooled(envelope, first, count) {
  const bins = new Float32Array(Math.max(count, 0));
  for (let k = 0; k < bins.length; k += 1) {
    for (let n = first + k * BIN; n < first + (k + 1) * BIN; n += 1) {
      if (n >= 0 && n < envelope.length && envelope[n] > bins[k]) bins[k] = envelope[n];
    }
  }
  return bins;
}

/**
 * Where others' chirps begin: bin and level of each. What their echoes may be is none.
 * @param {Float32Array} bins @param {number} least @param {Beginning[]} before
 */
function beginnings(bins, least, before) {
  const found = [...before];
  const isNew = () => found.length > before.length;
  bins.forEach((level, k) => {
    if (!(level > least)) return;
    const last = /** @type {Beginning} */ (found.at(-1)); // where one is new
    if (isNew() && k - last[0] <= DIRECT) {
      if (level > last[1]) found[found.length - 1] = [k, level];
    } else if (level > Math.max(0, ...found.map((chirp) => echoAt(chirp, k)))) {
      found.push([k, level]);
    }
  });
  return found.slice(before.length);
}

/** @param {Beginning} chirp @param {number} k */
function echoAt([begin, level], k) {
  return k - begin < SAME ? LOUDEST_ECHO * level * FADES ** ((k - begin) / SAME) : 0;
}

/** @param {Float32Array} envelope @param {number} due */
function arrivalIn(envelope, due) {
  let best = Math.max(due - SLACK, 0);
  for (let k = best; k < Math.min(due + SLACK + 1, envelope.length); k += 1) {
    if (envelope[k] > envelope[best]) best = k;
  }
  return best;
}

/** @param {Float32Array} values */
function middle(values) {
  const sorted = Float32Array.from(values).sort();
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : Math.fround((sorted[half - 1] + sorted[half]) / 2);
}

/**
 * Who chirps when, by the rules of elfslam.stages.medium_access: slots in rounds, kept where nobody else is heard
 * and given up where one is. What was heard in a slot some rounds ago tells who will chirp in it, however
 * late a phone hears. All functions are pure; chance is given to them.
 */

/**
 * The parameters of elfslam.stages.medium_access, by their names there.
 * @typedef {{jitter_s: number, softer_db: number, slots: number, listen: number, forget: number, check: number,
 *   check_least: number, check_alone: number, free_after: number, claim: number, keep: number, challenge: number,
 *   stir: number, follow: number, contrast: number, share: number, frames: number}} MediumAccessParameters
 * Whose turn it is, by slot of the round: whether it is ours; rounds since another phone was heard in it;
 * how often we kept silent in it, as it is ours, and heard nobody. alone: slots since another was heard.
 * @typedef {{mine: boolean[], quiet: number[], sure: number[], alone: number, shiftS: number}} SlotSchedule
 */

/** Where everybody begins: listening. @param {MediumAccessParameters} parameters @returns {SlotSchedule} */
export function initialSchedule({ slots, forget, listen }) {
  const nothing = Array(slots).fill(0);
  return { mine: Array(slots).fill(false), quiet: nothing, sure: nothing, alone: forget - listen, shiftS: 0 };
}

/**
 * Whether to chirp in a slot, counted from the beginning.
 * @param {SlotSchedule} schedule @param {number} slot @param {number} draw uniform in [0, 1)
 * @param {MediumAccessParameters} parameters
 */
export function isPlayed(schedule, slot, draw, parameters) {
  if (schedule.alone >= parameters.forget) return draw >= parameters.check_alone;
  const k = slot % parameters.slots;
  const silent = Math.max(parameters.check / (1 + schedule.sure[k]), parameters.check_least);
  return schedule.mine[k] && draw >= silent;
}

/**
 * What is known once a slot has been heard.
 * @param {SlotSchedule} schedule @param {number} slot
 * @param {number[]} othersS others' chirps in it, from the middle of where the own would be played
 * @param {boolean} isPlayedIn whether there was an own one
 * @param {number} draw uniform in [0, 1)
 * @param {MediumAccessParameters} parameters
 * @returns {SlotSchedule}
 */
export function afterSlot(schedule, slot, othersS, isPlayedIn, draw, parameters) {
  const k = slot % parameters.slots;
  const met = othersS.length > 0;
  const now = {
    ...schedule,
    quiet: schedule.quiet.with(k, met ? 0 : schedule.quiet[k] + 1),
    alone: met ? 0 : schedule.alone + 1,
    shiftS: schedule.shiftS + parameters.follow * othersS.reduce((sum, each) => sum + each, 0),
  };
  if (now.alone >= parameters.forget) {
    return { ...now, mine: schedule.mine.map(() => true), sure: schedule.sure.map(() => 0) };
  }
  const kept = isKept(now, k, draw, parameters);
  const isQuiet = kept && !met;
  const isChecked = schedule.mine[k] && isQuiet && !isPlayedIn;
  const sure = isQuiet ? schedule.sure[k] + (isChecked ? 1 : 0) : 0;
  return { ...now, mine: schedule.mine.with(k, kept), sure: schedule.sure.with(k, sure) };
}

/**
 * Whether a slot that was just heard is ours from now on.
 * @param {SlotSchedule} schedule @param {number} k @param {number} draw @param {MediumAccessParameters} parameters
 */
function isKept(schedule, k, draw, parameters) {
  const own = schedule.mine.filter(Boolean).length;
  if (schedule.mine[k]) {
    if (schedule.quiet[k] === 0) return draw >= own / (own + parameters.keep);
    return draw >= (parameters.stir * own) / parameters.slots;
  }
  if (schedule.quiet[k] >= parameters.free_after) return draw < parameters.claim / (1 + own);
  return own === 0 && draw < parameters.challenge;
}

/**
 * The direct arrival in every frame, by the decisions of elfslam.stages.echo, made as the sound comes in:
 * near where it is due; anywhere in the period where it is not; an earlier peak of enough strength counts.
 *
 * What differs from Python: how loud an arrival typically is Python takes from the whole recording, this
 * from the frames of the last seconds. A recording without chirps is refused there; here nothing is found
 * until frames have them.
 */

import { ECHO_RATE_HZ } from "./constants.js";
import { earliest, median, strongest } from "./matched_filter.js";

/** Frames of which the typical level is known: five seconds, after which another volume is the usual one. */
const REMEMBERED = 50;

/**
 * @typedef {import("./resample.js").Stream} Stream
 * @typedef {{slack_s: number, early_s: number, latest_s: number, early_share: number, level_share: number,
 *   contrast: number}} EchoParameters the group `echo`
 * @typedef {{sample: number, due: number, level: number, jumped: number, isFound: boolean, played?: number}} Arrival at
 *   44.1 kHz; sample: of the direct arrival, or of what is loudest where it was due; level: of the envelope
 *   there; jumped: samples that it came off its time, 0 where it came as due; played: when, where that
 *   was told
 * @typedef {{next: (envelope: Stream, isOver: boolean) => Arrival[] | null,
 *   needs: () => number}} Search next: what has become of the next chirps, null where the envelope does
 *   not reach yet; needs: the first sample of the envelope that may still be asked for
 */

/**
 * @param {number} period samples
 * @param {EchoParameters} parameters
 * @returns {Search & {due: () => number | null}} due: where the next chirp is looked for, once it is known
 */
export function makePeriodSearch(period, parameters) {
  const slack = slackOf(parameters);
  const half = period >> 1;
  const directIn = makeDirect(parameters);
  const levelBefore = makeLevel(period, parameters);
  /** @type {number | null} */
  let due = null;
  let hasFound = false;

  /** @param {Stream} envelope @param {boolean} isOver */
  const begin = (envelope, isOver) => {
    if (envelope.end() < period && !isOver) return false;
    due ??= strongestIn(envelope, 0, period).sample;
    return true;
  };

  /** @param {Stream} envelope @param {boolean} isOver */
  const next = (envelope, isOver) => {
    if (due === null && !begin(envelope, isOver)) return null;
    const reaches = (/** @type {number} */ to) => isOver || envelope.end() >= to;
    const at = /** @type {number} */ (due);
    if (!reaches(at + slack + 1) || at >= envelope.end()) return null;
    const isKnown = levelBefore(envelope, at - slack) < Infinity;
    if (!isKnown && !reaches(at + period)) return null;
    const level = levelBefore(envelope, isKnown ? at - slack : at + period);
    const near = strongestIn(envelope, at - slack, at + slack + 1);
    if (near.value >= level) return found(envelope, near, 0);
    if (!reaches(at + half)) return null;
    const peak = strongestIn(envelope, at - half, at + half);
    return peak.value >= level ? found(envelope, peak, 1) : missed(envelope, at);
  };

  /**
   * `off`: 1 where the chirp did not come where it was due.
   * @param {Stream} envelope @param {{sample: number}} peak @param {number} off @returns {Arrival[]}
   */
  const found = (envelope, peak, off) => {
    const { sample, level } = directIn(envelope, peak);
    const arrival = { sample, due: hasFound ? /** @type {number} */ (due) : sample, level, isFound: true };
    const jumped = off * (sample - arrival.due);
    hasFound = true;
    due = sample + period;
    return [{ ...arrival, jumped }];
  };

  /** @param {Stream} envelope @param {number} at */
  const missed = (envelope, at) => {
    const arrivals = hasFound ? [missedAt(envelope, at, slack)] : [];
    due = at + period;
    return arrivals;
  };

  return { next, needs: () => (due ?? 0) - 2 * period, due: () => due };
}

/** @param {EchoParameters} parameters @returns {number} samples that a direct arrival may be off its time */
export function slackOf(parameters, rateHz = ECHO_RATE_HZ) {
  return Math.round(parameters.slack_s * rateHz);
}

/** A chirp that was not heard. @param {Stream} envelope @param {number} due @param {number} slack @returns {Arrival} */
export function missedAt(envelope, due, slack) {
  const isInside = due >= slack && due < envelope.end() - slack;
  const peak = isInside ? strongestIn(envelope, due - slack, due + slack + 1) : { sample: due, value: 0 };
  return { sample: peak.sample, due, level: peak.value, jumped: 0, isFound: false };
}

/**
 * The greatest value from sample `from` to `to`, without the last.
 * @param {Stream} envelope @param {number} from @param {number} to
 */
export function strongestIn(envelope, from, to) {
  const first = Math.max(from, 0);
  const values = envelope.slice(first, Math.max(Math.min(to, envelope.end()), first + 1));
  const best = strongest(values);
  return { sample: first + best, value: values[best] };
}

/**
 * What finds the direct arrival at or a little before a peak: an echo may be louder.
 * @param {EchoParameters} parameters
 * @returns {(envelope: Stream, peak: {sample: number}) => {sample: number, level: number}}
 */
export function makeDirect(parameters, rateHz = ECHO_RATE_HZ) {
  const early = Math.round(parameters.early_s * rateHz);
  return (envelope, peak) => {
    const first = Math.max(peak.sample - early - 1, 0);
    const values = envelope.slice(first, peak.sample + 1);
    const direct = earliest(values, peak.sample - first, early, parameters.early_share);
    return { sample: first + direct, level: values[direct] };
  };
}

/**
 * The least level of an arrival, from the loudest of each frame that is over by a sample, and at least
 * from the first; sound before sample `from` does not count. Frames that do not stand out
 * of their own noise do not count; Infinity without any.
 * @param {number} period @param {EchoParameters} parameters
 * @returns {(envelope: Stream, sample: number) => number}
 */
export function makeLevel(period, parameters, from = 0) {
  let counted = Math.floor(from / period);
  /** @type {number[]} */
  let peaks = [];
  const count = (/** @type {Stream} */ envelope) => {
    const frame = envelope.slice(counted * period, (counted + 1) * period).sort();
    const [floor, peak] = [frame[period >> 1], frame[period - 1]];
    if (peak >= parameters.contrast * Math.max(floor, 1e-9)) peaks = [...peaks, peak].slice(-REMEMBERED);
    counted += 1;
  };
  return (envelope, sample) => {
    const frames = Math.floor(Math.min(sample, envelope.end()) / period);
    while (counted < Math.max(frames, 1)) count(envelope);
    return peaks.length > 0 ? parameters.level_share * median(peaks) : Infinity;
  };
}

/**
 * The direct arrivals of chirps of which it is told when they were played, by the decisions of
 * elfslam.stages.echo, made as the sound comes in.
 *
 * Sound takes its time from playing to hearing, the same for all chirps until something jumps. What
 * differs from Python, as nobody knows what comes later: that time comes from the first chirps that
 * agree on one. A chirp that is not heard where it is due is held back, with all behind it, until it is
 * known whether it was lost or the time has jumped: two that agree on another time, and were not heard at
 * the old one, tell so at once.
 */

/** Chirps that are held back at the most; then the time from playing to hearing is unknown again. */
const TOGETHER = 8;
/** So many more agree on a time than on any other, one in an even rhythm; else most of them, by this share. */
const [FEWEST, AHEAD, CLEAR] = [4, 2, 0.8];
/** So many agree on a jump; further than half a period away somebody else's may do by chance. */
const [JUMPED, JUMPED_FAR] = [2, 3];
/** The median of so many arrivals says when the next one is due. */
const RECENT = 5;
/** Within this of a louder sound another counts as its echo, s. */
const APART_S = 0.02;
/** Chirps of which it is remembered how late they were. */
const REMEMBERED_LATE = 100;

/**
 * @typedef {Omit<Search, "next"> & {
 *   next: (envelope: Stream, isOver: boolean) => Scheduled[] | null, first: number,
 *   played: (sample: number) => void, late: (sample: number) => number | null | undefined,
 *   lateNow: () => number | null}} ScheduleSearch
 *   played: tells of the next chirp, before it is heard; late: how many samples late what is played at a
 *   sample is heard, undefined where that is not settled yet and null where its chirp was not; lateNow: as
 *   far as is known by now, null before the first chirp
 * @typedef {Arrival & {played: number}} Scheduled
 */

/**
 * @param {number} first the sample at which the first chirp is played
 * @param {number} period samples
 * @param {EchoParameters} parameters
 * @param {{rateHz?: number, guess?: number}} given guess: samples by which chirps are late, where none was
 *   heard yet
 * @returns {ScheduleSearch}
 */
export function makeScheduleSearch(first, period, parameters, { rateHz = ECHO_RATE_HZ, guess = 0 } = {}) {
  const slack = slackOf(parameters, rateHz);
  const half = period >> 1;
  const latest = Math.round(parameters.latest_s * rateHz);
  const apart = Math.round(APART_S * rateHz);
  const directIn = makeDirect(parameters, rateHz);
  const levelBefore = makeLevel(period, parameters, Math.max(first - 10 * period, 0));
  /** Chirps that are not settled; the first `held` of them are in doubt. */
  let [told, held, last] = [[first], 0, first];
  /**
   * How late chirps are heard, null where that is unknown; when one was heard last; as late as the last.
   * @type {[number | null, number | null, number[]]}
   */
  let [late, before, recent] = [null, null, []];
  /** Up to there the sound was searched for a time that is unknown; the last direct arrival. */
  let [reached, arrived] = [first, -Infinity];
  /** @type {{start: number, by: number | null}[]} */
  let settled = [];

  /** @param {Stream} envelope @param {boolean} isOver @returns {Scheduled[] | null} */
  const next = (envelope, isOver) => {
    if (late === null) return begin(envelope, isOver);
    if (held === told.length) return isOver && held > 0 ? settle(envelope, late) : null;
    const due = told[held] + late;
    if (!isOver && envelope.end() < Math.max(due + slack + 1, period)) return null;
    if (held === 0 && peakAt(envelope, due)) return settle(envelope, late, 1);
    if (!isOver && envelope.end() < due + half) return null;
    held += 1;
    return decide(envelope, Math.min(due + half, envelope.end()));
  };

  /** What is loud where a chirp is due; null where nothing is. @param {Stream} envelope @param {number} due */
  const peakAt = (envelope, due) => {
    if (due < slack || due >= envelope.end() - slack) return null;
    const peak = strongestIn(envelope, due - slack, due + slack + 1);
    return peak.value >= levelBefore(envelope, due - slack) ? peak : null;
  };

  /**
   * Sound keeps its order: what was heard up to the last arrival is none of these chirps.
   * @param {Stream} envelope @param {number[]} chirps @param {number} until
   */
  const votes = (envelope, chirps, until) => {
    const from = Math.max(arrived + apart, chirps[0], 0);
    const values = envelope.slice(from, Math.max(until, from));
    const peaks = peaksOf(values, from, levelBefore(envelope, until), apart);
    return votesOf(chirps, peaks, { until, latest, alike: slack >> 1 });
  };

  /**
   * Whether chirps were lost or the time has jumped, once one more was looked for where it was due.
   * @param {Stream} envelope @param {number} until
   */
  const decide = (envelope, until) => {
    const chirps = told.slice(0, held);
    const usual = /** @type {number} */ (late);
    const heard = chirps.filter((start) => peakAt(envelope, start + usual)).length;
    const others = votes(envelope, chirps, until).filter((vote) => Math.abs(vote.late - usual) > slack);
    const rival = bestOf(others, ({ hits }) => hits, usual);
    const rivals = rival?.hits ?? 0;
    const wanted = rival && Math.abs(rival.late - usual) <= half ? JUMPED : JUMPED_FAR;
    if (rival && rivals >= Math.max(wanted, heard + AHEAD)) {
      const isOver = (/** @type {number} */ start) => start + rival.late + slack < until;
      return settle(envelope, rival.late, chirps.filter(isOver).length);
    }
    if (heard > 0 && (heard >= rivals || held >= TOGETHER)) return settle(envelope, usual);
    if (held >= TOGETHER) [late, held, recent, reached] = [null, 0, [], told[0]];
    return [];
  };

  /** @param {number[]} chirps */
  const isEven = (chirps) =>
    chirps.every((start) => Math.abs(start - chirps[0] - period * Math.round((start - chirps[0]) / period)) <= slack);

  /**
   * Looks further and further for the time from playing to hearing; null where sound must come first.
   * @param {Stream} envelope @param {boolean} isOver @returns {Scheduled[] | null}
   */
  const begin = (envelope, isOver) => {
    while (told.length >= FEWEST || (isOver && told.length > 0)) {
      const chirps = told.slice(0, TOGETHER);
      const end = chirps[chirps.length - 1] + latest + slack + 1;
      const until = Math.min(reached + half, end);
      if (!isOver && envelope.end() < Math.max(until, period)) return null;
      late = clearest(votes(envelope, chirps, until), slack, isEven(chirps) ? 1 : AHEAD);
      if (late !== null) return [];
      const isFar = until >= end;
      if (isFar && (isOver || chirps.length === TOGETHER)) return passOver(envelope);
      if (isFar) return null;
      reached = until;
    }
    return null;
  };

  /** @param {Stream} envelope @param {number} time @returns {Scheduled[]} */
  const settle = (envelope, time, count = held) => {
    const old = /** @type {number} */ (late);
    if (Math.abs(time - old) > slack) recent = [];
    [late, held] = [time, 0];
    let isOld = true;
    return told.splice(0, count).map((start) => {
      const peak = peakAt(envelope, start + time);
      isOld &&= !peak;
      const earlier = isOld ? peakAt(envelope, start + old) : null;
      const due = start + (isOld ? old : time);
      const heard = peak ?? earlier;
      return heard ? found(envelope, heard, start, due) : missed(envelope, start, due);
    });
  };

  /**
   * @param {Stream} envelope @param {{sample: number}} peak @param {number} start @param {number} due
   * @returns {Scheduled}
   */
  const found = (envelope, peak, start, due) => {
    const { sample, level } = directIn(envelope, peak);
    const by = due - start;
    const jumped = before !== null && Math.abs(by - before) > slack ? by - before : 0;
    [before, arrived] = [by, sample];
    recent = [...recent.filter((each) => Math.abs(each - by) <= slack), sample - start].slice(-RECENT);
    if (Math.abs(/** @type {number} */ (late) - by) <= slack) late = before = Math.round(median(recent));
    remember(start, sample - start);
    return { sample, due, level, jumped, isFound: true, played: start };
  };

  /** @param {Stream} envelope @param {number} start @param {number} due @returns {Scheduled} */
  const missed = (envelope, start, due) => {
    remember(start, null);
    return { ...missedAt(envelope, due, slack), played: start };
  };

  /** @param {Stream} envelope @returns {Scheduled[]} */
  const passOver = (envelope) => {
    const chirps = told.splice(0, TOGETHER / 2);
    reached = told[0] ?? reached;
    return chirps.map((start) => {
      remember(start, null);
      return { ...missedAt(envelope, start + (before ?? guess), slack), played: start };
    });
  };

  /** @param {number} start @param {number | null} by */
  const remember = (start, by) => {
    settled = [...settled, { start, by }].slice(-REMEMBERED_LATE);
  };

  /** @param {number} sample */
  const lateAt = (sample) => {
    if (told.length > 0 && told[0] <= sample) return undefined;
    const nearest = settled.findLast(({ start }) => start <= sample) ?? settled[0];
    return nearest ? nearest.by : guess;
  };

  /** @param {number} sample */
  const played = (sample) => {
    told.push(sample);
    last = sample;
  };

  const needs = () => (told[0] ?? last) - period;

  return { first, next, needs, played, late: lateAt, lateNow: () => late ?? before };
}

/**
 * The time on which chirps agree; null where they do not yet. The earliest of equals: an even rhythm fits
 * whole periods later as well.
 * @param {Vote[]} all @param {number} slack @param {number} ahead
 */
function clearest(all, slack, ahead) {
  const best = bestOf(all, leadOf, 0);
  if (best === null || best.hits < FEWEST) return null;
  const rival = bestOf(all.filter(({ late }) => Math.abs(late - best.late) > slack), leadOf, 0);
  const isAhead = leadOf(best) >= Math.max(FEWEST, rival ? leadOf(rival) + ahead : 0);
  const isClear = best.due >= TOGETHER && best.hits >= CLEAR * best.due;
  return isAhead || isClear ? best.late : null;
}

// How late chirps are heard, told by the sound itself: the time on which most of them agree. Pure.

/**
 * late: samples from playing to hearing; hits: chirps that are heard so late; due: those that should be.
 * @typedef {{late: number, hits: number, due: number}} Vote
 */

/**
 * Where something is loud: peaks of an envelope that begins at sample `first`, none near a greater one.
 * @param {Float32Array} envelope @param {number} first @param {number} level the least that counts
 * @param {number} apart samples within which only the greatest counts
 * @returns {number[]} samples
 */
function peaksOf(envelope, first, level, apart) {
  const peaks = [];
  for (let k = 0; k < envelope.length; k += 1) {
    if (!(envelope[k] >= level)) continue;
    const last = peaks.at(-1);
    if (last === undefined || k - last > apart) peaks.push(k);
    else if (envelope[k] > envelope[last]) peaks[peaks.length - 1] = k;
  }
  return peaks.map((k) => first + k);
}

/**
 * A vote for every time by which some peak may be one of the chirps.
 * @param {number[]} played samples at which chirps were played, in their order
 * @param {number[]} peaks samples, in their order
 * @param {{until: number, latest: number, alike: number}} given until: what is due there was not heard yet;
 *   latest: the longest that sound takes; alike: times within this of each other are the same
 * @returns {Vote[]}
 */
function votesOf(played, peaks, { until, latest, alike }) {
  const times = played.flatMap((start) => peaks.map((peak) => peak - start));
  const possible = [...new Set(times)].filter((time) => time >= 0 && time <= latest);
  return possible.map((time) => {
    const found = played.map((start) => differenceTo(start + time, peaks, alike)).filter((off) => off !== null);
    const due = played.filter((start) => start + time < until).length;
    return { late: time + Math.round(median(found)), hits: found.length, due: Math.max(due, found.length) };
  });
}

/**
 * From a sample to the peak nearest to it; null where none is near.
 * @param {number} sample @param {number[]} peaks @param {number} alike
 */
function differenceTo(sample, peaks, alike) {
  let best = null;
  for (const peak of peaks) {
    const off = peak - sample;
    if (Math.abs(off) <= alike && (best === null || Math.abs(off) < Math.abs(best))) best = off;
  }
  return best;
}

/** Chirps heard beyond those that should have been and were not. @param {Vote} vote */
function leadOf({ hits, due }) {
  return 2 * hits - due;
}

/**
 * The vote with the greatest worth, the nearest to `late` among equals.
 * @param {Vote[]} votes @param {(vote: Vote) => number} worth @param {number} late
 * @returns {Vote | null}
 */
function bestOf(votes, worth, late) {
  /** @param {Vote} a @param {Vote} b */
  const before = (a, b) => worth(b) - worth(a) || Math.abs(a.late - late) - Math.abs(b.late - late);
  return votes.reduce(
    (best, vote) => (best === null || before(vote, best) < 0 ? vote : best), /** @type {Vote | null} */ (null),
  );
}

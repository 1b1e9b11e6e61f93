/** Echo cutting as elfslam.stages.echo does it, while the sound comes in. */

import { DISCARDED_SAMPLES, ECHO_RATE_HZ, ECHO_SAMPLES, FACTS } from "./constants.js";
import { makePeriodSearch, makeScheduleSearch } from "./echo_arrivals.js";
import { atEchoRate, makeEnvelope } from "./matched_filter.js";
import { makeResampler, makeStream } from "./resample.js";

/** Sound that is remembered at the most, whatever is still waited for. */
const REMEMBERED = 10 * ECHO_RATE_HZ;
/** Of the envelope so much is there for whoever listens to others, which waits for the own chirps. */
const HEARD = 4 * ECHO_RATE_HZ;
/** Frames whose facts are kept until somebody asks. */
const UNASKED = 1000;

/**
 * @typedef {import("./echo_arrivals.js").Arrival} Arrival
 * @typedef {import("./echo_arrivals.js").EchoParameters} EchoParameters
 * @typedef {import("./echo_arrivals.js").ScheduleSearch} ScheduleSearch
 * @typedef {{tS: number, samples: Float32Array, directLevel: number,
 *   facts: {lateS: number, jumpedS: number}}} Echo tS: of the direct arrival, on the clock of the samples
 *   that came in; samples (2352) at 44.1 kHz; lateS: after it was due; jumpedS: where it came off its time
 * @typedef {{push: (first: number, samples: Float32Array) => Echo[], end: () => Echo[],
 *   frames: () => FrameFacts[],
 *   played: (tS: number, gainDb?: number) => void,
 *   latenessS: () => number | null,
 *   heard: import("./hearing.js").HeardSound & {sampleAt: (tS: number) => number}}} EchoCutter
 *   latenessS: from playing to hearing, null before a told chirp was heard; heard: at 44.1 kHz
 */

/**
 * A cutter for a stream of sound. `push` takes samples that begin at sample `first` (what is missing
 * between is silence) and gives the echoes that they complete: an echo is whole 64 ms after its direct
 * sound, and at 48 kHz 2 ms later. However the stream is cut into blocks, the echoes are the same to the
 * last bit. `end` gives those that a stream that ends here still holds. Where chirps follow a schedule,
 * `played` tells of each when it begins to be played, and how loud, in their order and before it is heard; up
 * to the first that is told they are taken to come once per period. `frames` gives what was heard around each chirp,
 * of those that became complete since it was asked last; that is when the next chirp has come.
 *
 * Times are those of the clock that counts the samples. Python, that knows recordings only as what is
 * left of them, puts lost stretches back; a page is told which samples it lost.
 * @param {{rateHz: number, chirp: Float32Array,
 *   parameters: {chirp: {period_s: number}, echo: EchoParameters}}} given chirp: as it is
 *   played at `rateHz`, 44100 or 48000; parameters: groups as elfslam names them
 * @returns {EchoCutter}
 */
export function makeEchoCutter({ rateHz, chirp, parameters }) {
  const input = makeInput(rateHz);
  const envelopeOf = makeEnvelope(atEchoRate(chirp, rateHz));
  const period = Math.round(parameters.chirp.period_s * ECHO_RATE_HZ);
  const [sound, envelope] = [makeStream(ECHO_RATE_HZ), makeStream(ECHO_RATE_HZ)];
  const byPeriod = makePeriodSearch(period, parameters.echo);
  /** @type {ScheduleSearch | null} */
  let bySchedule = null;
  const facts = makeFacts();
  /** @type {[[number, number | undefined][], Arrival[], FrameFacts[]]} */
  let [told, waiting, known] = [[], [], []];
  let latest = -1;
  /**
   * How loud chirps were played that are not heard yet, by their samples.
   * @type {Map<number | undefined, number | undefined>}
   */
  const gains = new Map();

  /** @param {number} tS @param {number} [gainDb] */
  const played = (tS, gainDb) => {
    if (!input.hasBegun()) {
      told.push([tS, gainDb]);
      return;
    }
    const sample = Math.round((tS - input.startS()) * ECHO_RATE_HZ);
    gains.set(sample, gainDb);
    if (bySchedule) bySchedule.played(sample);
    else bySchedule = makeScheduleSearch(sample, period, parameters.echo);
  };

  /** @returns {import("./echo_arrivals.js").Search} */
  const search = () => {
    const isScheduled = bySchedule && (byPeriod.due() ?? Infinity) >= bySchedule.first;
    return isScheduled ? /** @type {ScheduleSearch} */ (bySchedule) : byPeriod;
  };

  /** @param {Float32Array} samples @param {boolean} isOver */
  const take = (samples, isOver) => {
    sound.append(sound.end(), samples);
    envelope.append(envelope.end(), envelopeOf.push(samples));
    if (isOver) envelope.append(envelope.end(), envelopeOf.end());
    /** @type {Arrival[]} */
    const arrivals = [];
    for (let more = /** @type {Arrival[] | null} */ ([]); more; more = search().next(envelope, isOver)) {
      arrivals.push(...more.filter(isLater));
    }
    waiting.push(...arrivals.filter(({ isFound }) => isFound));
    const louder = arrivals.map(withGain);
    known = [...known, ...facts.take(louder, { sound, envelope }, isOver)].slice(-UNASKED);
    const echoes = cutReady();
    forget();
    return echoes;
  };

  /** A chirp that was found untold may be told of after all. @param {Arrival} arrival */
  const isLater = ({ sample }) => {
    if (sample <= latest) return false;
    latest = sample;
    return true;
  };

  /** @param {Arrival} arrival */
  const withGain = (arrival) => {
    const gainDb = gains.get(arrival.played);
    gains.delete(arrival.played);
    return { ...arrival, gainDb };
  };

  const cutReady = () => {
    const ready = waiting.filter(({ sample }) => endOf(sample) <= sound.end());
    waiting = waiting.slice(ready.length);
    return ready.map(cut).filter(({ samples }) => samples.some((value) => value !== 0));
  };

  /** @param {Arrival} arrival @returns {Echo} */
  const cut = ({ sample, due, level, jumped }) => ({
    tS: input.startS() + sample / ECHO_RATE_HZ,
    samples: sound.slice(sample + DISCARDED_SAMPLES, endOf(sample)),
    directLevel: level,
    facts: { lateS: (sample - due) / ECHO_RATE_HZ, jumpedS: jumped / ECHO_RATE_HZ },
  });

  const forget = () => {
    const asked = [search(), bySchedule ?? search(), facts].map((each) => each.needs());
    const end = envelope.end();
    const before = Math.max(Math.min(...asked, end - HEARD), end - REMEMBERED);
    envelope.forget(before);
    sound.forget(Math.min(before, waiting[0]?.sample ?? Infinity));
  };

  /** @param {number} first @param {Float32Array} samples */
  const push = (first, samples) => {
    const blocks = input.push(first, samples);
    told.splice(0).forEach(([tS, gainDb]) => played(tS, gainDb));
    return blocks.flatMap((block) => take(block, false));
  };

  const frames = () => known.splice(0).map((each) => ({ ...each, dueS: each.dueS + input.startS() }));

  const latenessS = () => {
    const late = bySchedule?.lateNow() ?? null;
    return late === null ? null : late / ECHO_RATE_HZ;
  };

  /** @type {EchoCutter["heard"]} */
  const heard = {
    envelope: envelope.slice,
    end: envelope.end,
    late: (sample) => (bySchedule ? bySchedule.late(sample) : 0),
    sampleAt: (tS) => Math.round((tS - input.startS()) * ECHO_RATE_HZ),
  };
  return { push, played, frames, latenessS, heard, end: () => take(input.end(), true) };
}

/** @param {number} sample */
function endOf(sample) {
  return sample + DISCARDED_SAMPLES + ECHO_SAMPLES;
}

/** The samples at 44.1 kHz, without gaps and in blocks of a second at most. @param {number} rateHz */
function makeInput(rateHz) {
  const resampler = makeResampler(rateHz);
  /** @type {number | null} */
  let start = null;
  let next = 0;
  /** @param {number} first @param {Float32Array} samples */
  const push = (first, samples) => {
    start ??= first;
    const blocks = [];
    for (let at = start + next; at < first; at += rateHz) {
      blocks.push(new Float32Array(Math.min(rateHz, first - at)));
    }
    const known = samples.subarray(Math.max(start + next - first, 0));
    for (let at = 0; at < known.length; at += rateHz) blocks.push(known.subarray(at, at + rateHz));
    next += blocks.reduce((sum, block) => sum + block.length, 0);
    return blocks.map(resampler.push);
  };
  const startS = () => /** @type {number} */ (start) / rateHz;
  return { push, end: resampler.end, hasBegun: () => start !== null, startS };
}

// What else was heard around each chirp, as elfslam.stages.echo's frame_facts says it.

/** QUIET: from how long before a direct arrival to how long before it nothing should be heard; OVER: behind it. */
const { QUIET, OVER, FULL_SCALE } = FACTS;

/**
 * @typedef {import("./resample.js").Stream} Stream
 * @typedef {{sound: Stream, envelope: Stream}} Heard
 * @typedef {import("./echo_arrivals.js").Arrival & {gainDb?: number}} Played
 */

/**
 * Of the envelope of the matched filter: `level` of the direct sound, `before` the largest in the quiet
 * stretch before it over that, `noise` the typical there.
 * @typedef {{dueS: number, lateS: number, level: number, before: number, noise: number, clipped: number,
 *   gainDb?: number}} FrameFacts dueS: when its direct sound was due; lateS: how much later it came, NaN where
 *   it did not; clipped: share of samples at full scale; gainDb: how loud it was played, where that was told
 */

/**
 * Facts of chirps as they become complete, which is when their echoes are over.
 * @returns {{take: (arrivals: Played[], heard: Heard, isOver: boolean) => FrameFacts[], needs: () => number}}
 */
function makeFacts() {
  /** @type {number | null} */
  let before = null;
  /** @type {Played[]} */
  const waiting = [];

  /** @param {Played[]} arrivals @param {Heard} heard @param {boolean} isOver */
  const take = (arrivals, heard, isOver) => {
    waiting.push(...arrivals);
    const facts = [];
    while (waiting.length > 0 && isComplete(heard.sound, isOver)) {
      const arrival = /** @type {Played} */ (waiting.shift());
      facts.push(factsOf(arrival, before, heard));
      before = arrival.sample;
    }
    return facts;
  };

  /** By then its echo is cut, which spoofing wants first. @param {Stream} sound @param {boolean} isOver */
  const isComplete = (sound, isOver) => isOver || sound.end() >= waiting[0].sample + OVER;

  return { take, needs: () => (waiting.length > 0 ? waiting[0].sample - QUIET[0] : Infinity) };
}

/**
 * @param {Played} arrival @param {number | null} before @param {Heard} heard
 * @returns {FrameFacts}
 */
function factsOf({ sample, due, level, isFound, gainDb }, before, { sound, envelope }) {
  const dueS = due / ECHO_RATE_HZ;
  const lateS = isFound ? (sample - due) / ECHO_RATE_HZ : NaN;
  const nothing = { dueS, lateS, level: 0, before: 0, noise: 0, clipped: 0, gainDb };
  if (sample < 0 || sample >= envelope.end()) return nothing;
  const begin = Math.max(sample - QUIET[0], before === null ? 0 : before + OVER, 0);
  const quiet = between(envelope, begin, sample - QUIET[1]);
  const frame = between(sound, sample, Math.min(sample + OVER, sound.end()));
  return {
    dueS,
    lateS,
    level,
    before: most(quiet) / Math.max(level, 1e-9),
    noise: middle(quiet),
    clipped: frame.filter((value) => Math.abs(value) >= FULL_SCALE).length / frame.length,
    gainDb,
  };
}

/** @param {Stream} stream @param {number} from @param {number} to */
function between(stream, from, to) {
  return stream.slice(from, Math.max(Math.min(to, stream.end()), from));
}

/** @param {Float32Array} values */
function most(values) {
  return values.reduce((highest, value) => Math.max(highest, value), 0);
}

/** @param {Float32Array} values */
function middle(values) {
  if (values.length === 0) return 0;
  const half = values.length >> 1;
  const sorted = values.sort();
  return values.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}

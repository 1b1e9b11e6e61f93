/** Echo cutting as elfslam.line.echo does it, while the sound comes in. */

import { makePeriodSearch } from "./echo_arrivals.js";
import { makeEnvelope } from "./echo_envelope.js";
import { makeScheduleSearch } from "./echo_schedule.js";
import { makeFacts } from "./echo_facts.js";
import { ECHO_SAMPLES } from "./encoder.js";
import { ECHO_RATE_HZ, makeResampler } from "./resample.js";
import { makeStream } from "../phone/stream.js";

/** 10 ms of direct path and 1 ms of reflection off the holder's body, at 44.1 kHz. */
export const DISCARDED_SAMPLES = 485;
/** Sound that is remembered at the most, whatever is still waited for. */
const REMEMBERED = 10 * ECHO_RATE_HZ;
/** Frames whose facts are kept until somebody asks. */
const UNASKED = 1000;

/**
 * @typedef {{tS: number, samples: Float32Array, directLevel: number,
 *   facts: {lateS: number, jumpedS: number}}} Echo tS: of the direct arrival, on the clock of the samples
 *   that came in; samples (2352) at 44.1 kHz; lateS: after it was due; jumpedS: where it came off its time
 * @typedef {{push: (first: number, samples: Float32Array) => Echo[], end: () => Echo[],
 *   frames: () => import("./echo_facts.js").FrameFacts[], played: (tS: number) => void}} EchoCutter
 */

/**
 * A cutter for a stream of sound. `push` takes samples that begin at sample `first` (what is missing
 * between is silence) and gives the echoes that they complete: an echo is whole 64 ms after its direct
 * sound, and at 48 kHz 2 ms later. However the stream is cut into blocks, the echoes are the same to the
 * last bit. `end` gives those that a stream that ends here still holds. Where chirps follow a schedule,
 * `played` tells of each when it begins to be played, in their order, the first before any sound and each
 * before it is heard; untold, they come once per period. `frames` gives what was heard around each chirp,
 * of those that became complete since it was asked last; that is when the next chirp has come.
 *
 * Times are those of the clock that counts the samples. Python, that knows recordings only as what is
 * left of them, puts lost stretches back; a page is told which samples it lost.
 * @param {{rateHz: number, chirp: Float32Array, parameters: {chirp: Object, echo: Object}}} given chirp:
 *   as it is played at `rateHz`, 44100 or 48000; parameters: groups as elfslam names them
 * @returns {EchoCutter}
 */
export function makeEchoCutter({ rateHz, chirp, parameters }) {
  const input = makeInput(rateHz);
  const envelopeOf = makeEnvelope(chirp, rateHz);
  const period = Math.round(parameters.chirp.period_s * ECHO_RATE_HZ);
  const [sound, envelope] = [makeStream(ECHO_RATE_HZ), makeStream(ECHO_RATE_HZ)];
  let search = null;
  const facts = makeFacts();
  let [told, waiting, known] = [[], [], []];

  const begin = () => {
    search = (told.length > 0 ? makeScheduleSearch : makePeriodSearch)(period, parameters.echo);
    told.forEach(played);
  };

  const played = (tS) => {
    if (search === null) told.push(tS);
    else search.played?.(Math.round((tS - input.startS()) * ECHO_RATE_HZ));
  };

  const take = (samples, isOver) => {
    sound.append(sound.end(), samples);
    envelope.append(envelope.end(), envelopeOf.push(samples));
    if (isOver) envelope.append(envelope.end(), envelopeOf.end());
    const arrivals = [];
    for (let more = []; more; more = search.next(envelope, isOver)) arrivals.push(...more);
    waiting.push(...arrivals.filter(({ isFound }) => isFound));
    known = [...known, ...facts.take(arrivals, { sound, envelope }, isOver)].slice(-UNASKED);
    const echoes = cutReady();
    forget();
    return echoes;
  };

  const cutReady = () => {
    const ready = waiting.filter(({ sample }) => endOf(sample) <= sound.end());
    waiting = waiting.slice(ready.length);
    return ready.map(cut).filter(({ samples }) => samples.some((value) => value !== 0));
  };

  const cut = ({ sample, due, level, jumped }) => ({
    tS: input.startS() + sample / ECHO_RATE_HZ,
    samples: sound.slice(sample + DISCARDED_SAMPLES, endOf(sample)),
    directLevel: level,
    facts: { lateS: (sample - due) / ECHO_RATE_HZ, jumpedS: jumped / ECHO_RATE_HZ },
  });

  const forget = () => {
    const before = Math.max(Math.min(search.needs(), facts.needs()), envelope.end() - REMEMBERED);
    envelope.forget(before);
    sound.forget(Math.min(before, waiting[0]?.sample ?? Infinity));
  };

  const push = (first, samples) => {
    const blocks = input.push(first, samples);
    if (search === null) begin();
    return blocks.flatMap((block) => take(block, false));
  };

  const frames = () => known.splice(0).map((each) => ({ ...each, dueS: each.dueS + input.startS() }));

  return { push, played, frames, end: () => (search === null ? [] : take(input.end(), true)) };
}

function endOf(sample) {
  return sample + DISCARDED_SAMPLES + ECHO_SAMPLES;
}

/** The samples at 44.1 kHz, without gaps and in blocks of a second at most. */
function makeInput(rateHz) {
  const resampler = makeResampler(rateHz);
  let start = null;
  let next = 0;
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
  return { push, end: resampler.end, startS: () => (start ?? 0) / rateHz };
}

/** The direct arrivals of chirps of which it is told when they were played, at the microphone's own rate. */

import { makeEnvelope } from "../stages/matched_filter.js";
import { makeScheduleSearch } from "../stages/echo_schedule.js";
import { RULES } from "./arrivals.js";
import { makeStream } from "../stages/resample.js";

/** Of the envelope so much is remembered for whoever listens to others. */
const HEARD_S = 4;
/** The rules by the names of elfslam.stages.echo. */
const PARAMETERS = {
  slack_s: RULES.slackS,
  early_s: RULES.earlyS,
  early_share: RULES.earlyShare,
  level_share: RULES.levelShare,
  contrast: RULES.contrast,
  latest_s: 1,
};

/**
 * @typedef {import("./arrivals.js").Arrival & {played: number}} Arrival
 * @typedef {import("../stages/echo_schedule.js").Scheduled} Scheduled
 */

/**
 * `push` takes the next samples and gives the arrivals that they settle, in their order; `played` tells
 * when a chirp is played, before it is heard; `needs` gives the first sample that may still become one.
 * @param {{rateHz: number, chirp: Float32Array, period: number, guess: number, origin?: number}} given guess:
 *   samples from playing to hearing, as long as nothing is heard; origin: the sample at which the stream begins
 * @returns {{push: (samples: Float32Array) => Arrival[], played: (sample: number) => void,
 *   hasBegun: () => boolean, needs: () => number, heard: import("../stages/hearing.js").HeardSound}}
 */
export function makeScheduled({ rateHz, chirp, period, guess, origin = 0 }) {
  const envelopeOf = makeEnvelope(chirp);
  const envelope = makeStream(HEARD_S * rateHz, origin);
  /** @type {import("../stages/echo_schedule.js").ScheduleSearch | null} */
  let search = null;
  let hasHeard = false;

  /** @param {number} sample */
  const played = (sample) => {
    if (search) search.played(sample);
    else search = makeScheduleSearch(sample, period, PARAMETERS, { rateHz, guess });
  };

  /** Chirps that were played before any was heard went somewhere else. @param {Scheduled} arrival */
  const isKept = ({ sample, isFound }) => {
    hasHeard ||= isFound;
    return hasHeard && sample >= origin;
  };

  /** @param {Float32Array} samples */
  const push = (samples) => {
    envelope.append(envelope.end(), envelopeOf.push(samples));
    /** @type {Scheduled[]} */
    const arrivals = [];
    for (
      let more = /** @type {Scheduled[] | null | undefined} */ ([]);
      more;
      more = search?.next(envelope, false)
    ) arrivals.push(...more.filter(isKept));
    const needed = Math.min(search?.needs() ?? Infinity, envelope.end() - HEARD_S * rateHz);
    envelope.forget(needed - 2 * period);
    return arrivals.map(({ level, isFound, ...arrival }) => ({ ...arrival, isFound, peak: isFound ? level : 0 }));
  };

  /** @type {import("../stages/hearing.js").HeardSound} */
  const heard = {
    envelope: envelope.slice,
    end: envelope.end,
    late: (sample) => (search ? search.late(sample) : guess),
  };
  return { push, played, heard, hasBegun: () => search !== null, needs: () => search?.needs() ?? 0 };
}

/**
 * The direct arrivals of chirps of which it is told when they were played, by the decisions of
 * elfslam.line.echo, made as the sound comes in.
 *
 * Sound takes its time from playing to hearing, the same for all chirps until something jumps. What
 * differs from Python: that time comes from the first chirps that show it clearly, and from those that
 * were missed where several in a row were, as nobody knows what comes later.
 */

import { median } from "../phone/matched_filter.js";
import { makeDirect, makeLevel, missedAt, slackOf, strongestIn } from "./echo_arrivals.js";
import { ECHO_RATE_HZ } from "./resample.js";

/** Chirps that tell together how late they arrive; as many missed in a row make it unknown again. */
const TOGETHER = 8;
/** So many of them must be heard then. */
const CLEAR = 0.8;
/** The median of so many arrivals says when the next one is due. */
const RECENT = 5;
const ABOUT_AS_CLEAR = 0.95;

/**
 * @param {number} first the sample at which the first chirp is played
 * @param {number} period samples
 * @param {{slack_s: number, early_s: number, latest_s: number, early_share: number,
 *   level_share: number, contrast: number}} parameters the group `echo`
 * @returns {import("./echo_arrivals.js").Search & {first: number, played: (sample: number) => void}}
 *   played: tells of the next chirp, before it is heard
 */
export function makeScheduleSearch(first, period, parameters) {
  const slack = slackOf(parameters);
  const latest = Math.round(parameters.latest_s * ECHO_RATE_HZ);
  const directIn = makeDirect(parameters);
  const levelBefore = makeLevel(period, parameters, Math.max(first - 10 * period, 0));
  const played = [first];
  let row = 0;
  let late = null;
  let before = null;
  let recent = [];
  let missed = [];
  let reach = 0;

  /** Looks further and further for the time from playing to hearing; false where sound must come first. */
  const begin = (envelope, isOver) => {
    while (played.length >= row + TOGETHER) {
      const chirps = played.slice(row, row + TOGETHER);
      const end = chirps[TOGETHER - 1] + reach + slack + 1;
      if (!isOver && envelope.end() < Math.max(end, period)) return false;
      late = latenessOf(envelope, chirps, reach, slack, levelBefore(envelope, end));
      if (late !== null) return true;
      const isFar = reach >= latest;
      reach = isFar ? latest : Math.min(reach + (period >> 1), latest);
      if (isFar) return true;
    }
    return false;
  };

  const next = (envelope, isOver) => {
    if (late === null && !begin(envelope, isOver)) return null;
    if (late === null) return passOver(envelope);
    if (row >= played.length) return null;
    const due = played[row] + late;
    if (!isOver && envelope.end() < Math.max(due + slack + 1, period)) return null;
    const peak = strongestIn(envelope, due - slack, due + slack + 1);
    const isInside = due >= slack && due < envelope.end() - slack;
    row += 1;
    const isHeard = isInside && peak.value >= levelBefore(envelope, due - slack);
    return isHeard ? found(envelope, peak, due) : miss(envelope, due);
  };

  const found = (envelope, peak, due) => {
    const { sample, level } = directIn(envelope, peak);
    const jumped = before !== null && Math.abs(late - before) > slack ? late - before : 0;
    if (jumped !== 0) recent = [];
    before = late;
    recent = [...recent, sample - played[row - 1]].slice(-RECENT);
    late = Math.round(median(recent));
    const arrivals = [...missed, { sample, due, level, jumped, isFound: true }];
    missed = [];
    return arrivals;
  };

  /** Nothing is said of missed chirps before it is known that they were not heard at another time. */
  const miss = (envelope, due) => {
    missed.push(missedAt(envelope, due, slack));
    if (missed.length < TOGETHER) return [];
    row -= TOGETHER;
    [missed, late, reach, recent] = [[], null, 0, []];
    return [];
  };

  const passOver = (envelope) => {
    const chirps = played.slice(row, row + TOGETHER);
    row += TOGETHER;
    return chirps.map((start) => missedAt(envelope, start + (before ?? 0), slack));
  };

  const needs = () => played[Math.min(Math.max(row - TOGETHER, 0), played.length - 1)] - period;

  return { first, next, needs, played: (sample) => played.push(sample) };
}

/** How late these chirps arrive, up to `reach`; null where most of them are not heard so. */
function latenessOf(envelope, chirps, reach, slack, level) {
  const total = new Float64Array(reach + 1);
  for (const start of chirps) {
    const values = envelope.slice(Math.max(start, 0), start + reach + 1);
    const skipped = total.length - values.length;
    for (let k = 0; k < values.length; k += 1) total[skipped + k] += Math.sqrt(values[k]);
  }
  // The earliest of equals: a regular schedule fits whole periods later as well.
  const most = total.reduce((highest, value) => Math.max(highest, value), 0);
  const late = total.findIndex((value) => value >= ABOUT_AS_CLEAR * most);
  const isHeard = (start) => strongestIn(envelope, start + late - slack, start + late + slack + 1).value >= level;
  return chirps.filter(isHeard).length >= CLEAR * chirps.length ? late : null;
}

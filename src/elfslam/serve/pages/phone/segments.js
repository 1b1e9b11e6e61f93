/** The segments of a walk: recorded, paused by whatever takes the sound or the page away, gone on with, ended. */

/** After so long a pause nobody knows any more where the walker is: the walk is sent as it is. */
const MOST_PAUSE_S = 600;
/** A segment begins so much later than what was kept before it, at the least. */
const LEAST_PAUSE_S = 1;

/**
 * @typedef {import("./manifest.js").Walk} Walk
 * @typedef {import("./walking.js").Segment} Segment
 * @typedef {{isGoing: () => boolean, goOn: () => Promise<void>, pause: () => Promise<void>,
 *   flush: () => Promise<void>, mark: (marked: import("./walking.js").Marked) => void, end: () => Promise<void>}} Segments
 *   each takes its turn: two events at once do no harm
 */

/** When a walk goes on that was kept so far, on its own clock, s. @param {Walk} state @param {number} nowMs */
export function goesOnAt({ startUtc, facts }, nowMs) {
  return Math.max((nowMs - Date.parse(startUtc)) / 1000, facts.seconds + LEAST_PAUSE_S);
}

/** Whether a walk that was broken off may still go on. @param {Walk} state @param {number} nowMs */
export function mayGoOn(state, nowMs) {
  return !state.isOver && goesOnAt(state, nowMs) - state.facts.seconds < MOST_PAUSE_S;
}

/**
 * @param {Walk} state
 * @param {{begin: (fromS: number) => Promise<Segment>, close: () => Promise<void>, nowMs: () => number}} given begin:
 *   records from that time of the walk on; close: nothing more is added
 * @returns {Segments}
 */
export function makeSegments(state, { begin, close, nowMs }) {
  /** @type {Segment | null} */
  let segment = null;
  let isBegun = false;
  let isOver = false;
  /** @type {Promise<unknown>} */
  let last = Promise.resolve();
  /** @param {() => Promise<void>} work @returns {Promise<void>} */
  const inTurn = (work) => {
    const done = last.then(work);
    last = done.catch(() => {});
    return done;
  };

  const goOn = async () => {
    if (segment || isOver) return;
    const keptS = state.facts.seconds;
    const fromS = isBegun || keptS > 0 ? goesOnAt(state, nowMs()) : 0;
    segment = await begin(fromS);
    isBegun = true;
    if (fromS > 0) state.facts.gaps.push({ t_s: keptS, lost_s: fromS - keptS });
  };

  const pause = async () => {
    const paused = segment;
    segment = null;
    await paused?.pause();
  };

  const end = async () => {
    if (isOver) return;
    isOver = true;
    await pause();
    await close();
  };

  return {
    isGoing: () => segment !== null,
    goOn: () => inTurn(goOn),
    pause: () => inTurn(pause),
    flush: async () => segment?.flush(),
    mark: (marked) => segment?.mark(marked),
    end: () => inTurn(end),
  };
}

// What the page knows of the server, asked for again while something moves.

import { requestJson } from "../shared/api.js";
import { t } from "../shared/words.js";

/** @typedef {{id: string, name: string, device: string, state: "receiving" | "ready" | "refused", refusal: string | null, facts: any, files: {name: string, size_bytes: number}[], uploads: {id: string, file_name: string, offset_bytes: number, length_bytes: number | null}[], created_utc: string}} Recording */
/** @typedef {{id: string, kind: "map" | "merge" | "locate", state: "queued" | "running" | "done" | "failed" | "cancelled", given: any, gave: any, doing: string, share: number | null, attempts: number, problem: string | null, created_utc: string, started_utc: string | null, finished_utc: string | null}} Job */
/** @typedef {{id: string, name: string, kind: "run" | "floor", sources: string[], facts: any, floor_plan: any, files: any[], created_utc: string, venue: string | null, floor: string | null, level: number | null, owner: string, right: "read" | "edit" | "own", shared_with: number, has_link: boolean}} Map_ */
/** @typedef {{recordings: Recording[], jobs: Job[], maps: Map_[], loaded: boolean}} Known */

/**
 * Keep `known` fresh. @param {() => void} fresh after every answer: what is "just now" grows older
 * @param {(problem: unknown | null) => void} tell each outcome of asking
 */
export function keepKnown(fresh, tell) {
  /** @type {Known} */
  const known = { recordings: [], jobs: [], maps: [], loaded: false };
  let last = "";

  async function question() {
    const [recordings, jobs, maps] = await Promise.all(
      ["/api/recordings", "/api/jobs", "/api/maps"].map((path) => requestJson(path)));
    Object.assign(known, { recordings: newest(recordings), jobs: newest(jobs), maps: newest(maps), loaded: true });
    const now = JSON.stringify([recordings, jobs, maps]);
    const differs = now !== last;
    last = now;
    fresh();
    return differs || isMoving(known);
  }

  return { known, now: poll(question, tell).now };
}

/** Whether the server is at work. An upload that was left lying does not move.
 * @param {{jobs: Job[]}} known */
export function isMoving({ jobs }) {
  return jobs.some(isOpen);
}

/** @param {Job} job */
export function isOpen(job) {
  return job.state === "queued" || job.state === "running";
}

/** @template {{created_utc: string}} T @param {T[]} things @returns {T[]} */
function newest(things) {
  return [...things].sort((a, b) => b.created_utc.localeCompare(a.created_utc));
}

/** What a job works on, in the names that people gave. @param {Job} job @param {Known} known */
export function jobTitle({ kind, given }, { recordings, maps }) {
  const recording = recordings.find(({ id }) => id === given.recording)?.name ?? t("a deleted recording");
  const named = (/** @type {string} */ wanted) => maps.find(({ id }) => id === wanted)?.name ?? t("a deleted map");
  if (kind === "map") return recording;
  if (kind === "locate") return t("{{recording}} in {{map}}", { recording, map: named(given.map) });
  return given.name || (given.maps ?? []).map(named).join(" + ");
}

/** The newest job that maps a recording, and the newest map of it.
 * @param {string} id @param {Known} known @returns {{job: Job | undefined, map: Map_ | undefined}} */
export function mappingOf(id, { jobs, maps }) {
  const job = jobs.find((each) => each.kind === "map" && each.given.recording === id);
  const made = jobs.filter((each) => each.kind === "map" && each.given.recording === id).map((each) => each.gave?.map);
  return { job, map: maps.find((map) => made.includes(map.id) || (map.kind === "run" && map.sources.includes(id))) };
}

// Asking again and again: often while something moves, seldom while nothing does.

/** @typedef {{fast_ms: number, slow_ms: number, growth: number}} Pace */

/** @type {Pace} */
export const PACE = { fast_ms: 1000, slow_ms: 20_000, growth: 1.6 };

/**
 * The wait before the next question.
 * @param {number} last_ms the wait before this one @param {boolean} moving @param {Pace} [pace]
 * @returns {number} ms
 */
export function nextWait(last_ms, moving, pace = PACE) {
  if (moving) return pace.fast_ms;
  return Math.min(pace.slow_ms, Math.max(pace.fast_ms, last_ms * pace.growth));
}

/**
 * Ask now and go on asking, never twice at a time, not while the page is hidden.
 * @param {() => Promise<boolean>} question gives whether something moves; may throw
 * @param {(problem: unknown | null) => void} tell each outcome: null, or what went wrong
 * @returns {{now: () => Promise<void>}} `now` asks at once and resets the wait
 */
export function poll(question, tell) {
  let wait_ms = PACE.fast_ms;
  let timer = 0;
  /** @type {Promise<void> | null} */
  let running = null;
  let again = false;

  async function turn() {
    let moving = false;
    try {
      moving = await question();
      tell(null);
    } catch (problem) {
      tell(problem);
    }
    wait_ms = nextWait(wait_ms, moving);
  }

  function arm() {
    clearTimeout(timer);
    if (!document.hidden) timer = setTimeout(now, wait_ms);
  }

  /** @returns {Promise<void>} */
  function now() {
    clearTimeout(timer);
    if (running) {
      again = true;
      return running;
    }
    running = turn().then(() => {
      running = null;
      if (again) {
        again = false;
        return now();
      }
      arm();
    });
    return running;
  }

  document.addEventListener("visibilitychange", () => {
    wait_ms = PACE.fast_ms;
    if (document.hidden) clearTimeout(timer);
    else void now();
  });
  return {
    now() {
      wait_ms = PACE.fast_ms;
      return now();
    },
  };
}

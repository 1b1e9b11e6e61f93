// The jobs: what the server is doing, and what went wrong.

import { requestJson } from "../shared/api.js";
import { h, icon, svg } from "../shared/dom.js";
import {
  formatAgo, formatDuration, formatMoment, formatShare, missingLine, missingWords, secondsBetween, stageWords,
} from "../shared/format.js";
import { counted, t, translated } from "../shared/words.js";
import { orSay } from "./dialogs.js";
import {
  cell, emptyPage, headOf, iconButton, matching, nothingFound, rowHead, sorted, stateCell, tableOf, toolbarOf,
} from "./lists.js";
import { isOpen, jobTitle } from "./store.js";
import { part } from "./viewer/panel.js";

/** @typedef {import("./store.js").Job} Job */
/** @typedef {import("./store.js").Known} Known */
/** @typedef {import("./main.js").Desk} Desk */

const COLUMNS = [t("Job"), t("State"), t("Asked"), t("Took"), t("Actions")];
const KINDS = { map: t("Map", { context: "verb" }), merge: t("Merge"), locate: t("Locate") };

/** @type {Record<string, [string, string]>} */
const STATES = {
  queued: [t("Waiting"), "wait"], running: [t("Running"), "wait"], done: [t("Done"), "pass"],
  failed: [t("Failed"), "fail"], cancelled: [t("Cancelled"), "wait"],
};

/** A job that failed and yet left a map: no loop closed, say. @type {[string, string]} */
const HALF = [t("Map by steps alone"), "doubt"];

/** @param {Job} job */
const isHalf = ({ state, gave }) => state === "failed" && Boolean(gave?.map);

/** @param {Desk} desk */
export function jobsView({ known, orders, nowMs }) {
  const order = orders.jobs;
  const open = known.jobs.filter(isOpen).length;
  const words = open > 0 ? counted(open, "{{count}} job to do. The server goes on when this page is closed.", "{{count}} jobs to do. The server goes on when this page is closed.") : t("Nothing to do at the moment.");
  const named = known.jobs.map((job) => ({ job, name: jobTitle(job, known), created_utc: job.created_utc }));
  const found = matching(named, order.find, ({ job, name }) => [name, KINDS[job.kind], isHalf(job) ? HALF[0] : STATES[job.state]?.[0], job.problem]);
  const rows = sorted(found, order.by, () => null).map(({ job }) => rowOf(job, known, nowMs()));
  const all = known.jobs.length;
  return h("div", { class: "page" }, headOf(t("Jobs"), words),
    all > 1 && toolbarOf(t("Jobs"), order, ["newest", "oldest", "name"], { shown: rows.length, all }),
    rows.length > 0 ? tableOf(t("Jobs"), COLUMNS, rows)
      : all > 0 ? nothingFound(order.find) : emptyPage(known, "again", t("No jobs yet"), t("Mapping, merging and locating show up here.")));
}

/** @param {Job} job @param {Known} known @param {number} nowMs */
function rowOf(job, known, nowMs) {
  const title = jobTitle(job, known);
  const took_s = job.started_utc ? secondsBetween(job.started_utc, job.finished_utc, nowMs) : null;
  return h("tr", { "data-key": job.id, role: "row" },
    rowHead(h("span", { class: "kind" }, KINDS[job.kind] ?? job.kind), h("strong", null, title),
      job.attempts > 1 && h("small", null, t("attempt {{number}}", { number: job.attempts }))),
    stateCell(stateOfJob(job, leftOutOf(job, known))),
    cell(t("Asked"), h("time", { datetime: job.created_utc, title: job.created_utc }, formatAgo(job.created_utc, nowMs))),
    cell(t("Took"), formatDuration(took_s)),
    h("td", { class: "actions", role: "cell" }, outcomeLink(job, known),
      isOpen(job) && iconButton("stop", "cancel", job.id, t("Cancel {{what}}", { what: title })),
      (job.state === "failed" || job.state === "cancelled") && iconButton("again", "retry", job.id, t("Retry {{what}}", { what: title }))));
}

/** @param {Job} job @param {Known} known */
function outcomeLink(job, { maps }) {
  const shown = job.kind === "locate" ? job.given.map : job.gave?.map;
  if (isOpen(job) || !maps.some(({ id }) => id === shown)) return null;
  return h("a", { class: "button small", href: `#/maps/${encodeURIComponent(shown)}` }, t("See it"));
}

/** How many walks a merge left out. @param {Job} job @param {Known} known */
function leftOutOf(job, { maps }) {
  return Object.keys(maps.find(({ id }) => id === job.gave?.map)?.facts?.refused ?? {}).length;
}

/** Badge, progress and what it is at, or the one line of what went wrong.
 * @param {Job} job @param {number} [leftOut] walks that share no place with the others */
export function stateOfJob(job, leftOut = 0) {
  if (job.state === "running") {
    const known = job.share !== null;
    const bar = h("progress", { max: 1, value: known ? job.share : null, "aria-label": t("Progress") });
    return h("div", { class: "doing" }, bar, h("small", null, h("span", { class: "figures" }, formatShare(job.share)), ` ${job.doing ? stageWords(job.doing) : t("starting")}`));
  }
  const [words, verdict] = isHalf(job) ? HALF : leftOut > 0 ? [t("Done in part"), "doubt"] : (STATES[job.state] ?? [job.state, "wait"]);
  const lacks = leftOut > 0
    ? counted(leftOut, "{{count}} walk shares no place with the others and was left out.", "{{count}} walks share no place with the others and were left out.")
    : missingWords(job.gave?.missing, 1);
  return [h("span", { class: "badge", "data-verdict": verdict }, words), lacks && h("small", { class: "lacks" }, lacks),
    job.problem && job.state !== "done" && h("small", { class: "problem" }, translated(job.problem))];
}

/** @param {Desk} desk */
export function jobActions(desk) {
  const send = (/** @type {string} */ verb) => async (/** @type {string} */ id) => {
    await orSay(() => requestJson(`/api/jobs/${encodeURIComponent(id)}/${verb}`, { method: "POST" }));
    await desk.now();
  };
  return { cancel: send("cancel"), retry: send("retry") };
}

// A recording along its time: where it has sound and motion, and the stretch that is chosen of it.

/** @typedef {import("./store.js").Recording} Recording */
/** @typedef {[from: number, until: number]} Span seconds */
/** @typedef {{duration_s: number, lanes: [name: string, spans: Span[]][]}} Course */

const STEP_S = 0.1;
const LANE = 10;
const LANES = /** @type {const} */ ([["sound", t("Sound")], ["motion", t("Motion")]]);
/** The least that can be chosen, s. */
const LEAST_S = 2;

/** What is known of a recording along its time; null where nothing is. @param {Recording} recording
 * @returns {Course | null} */
export function courseOf({ facts }) {
  const duration_s = Number(facts?.duration_s);
  if (!(duration_s > LEAST_S)) return null;
  const spans = facts.spans_s ?? {};
  return { duration_s, lanes: LANES.filter(([what]) => what in spans).map(([what, name]) => [name, spans[what]]) };
}

/** The stretch that a person chose, as the job takes it: nothing where all of it is meant.
 * @param {number} from_s @param {number} until_s @param {number} duration_s
 * @returns {{from_s?: number, until_s?: number}} */
export function stretchOf(from_s, until_s, duration_s) {
  const whole = (/** @type {number} */ value) => Math.round(value / STEP_S) / Math.round(1 / STEP_S);
  return {
    ...(from_s > STEP_S / 2 ? { from_s: whole(from_s) } : {}),
    ...(until_s < duration_s - STEP_S ? { until_s: whole(until_s) } : {}),
  };
}

/** Both ends after one was moved: the other gives way. @param {Span} span @param {"from" | "until"} moved
 * @param {number} duration_s @returns {Span} */
export function apart([from_s, until_s], moved, duration_s) {
  if (until_s - from_s >= LEAST_S) return [from_s, until_s];
  if (moved === "from") return [Math.min(from_s, duration_s - LEAST_S), Math.min(from_s + LEAST_S, duration_s)];
  return [Math.max(until_s - LEAST_S, 0), Math.max(until_s, LEAST_S)];
}

/** A lane for the sound and one for the motion, and the stretch that counts. @param {Course} course
 * @param {Span} [chosen] */
function courseLanes({ duration_s, lanes }, [from_s, until_s] = [0, duration_s]) {
  const share = (/** @type {number} */ t_s) => (100 * Math.min(Math.max(t_s, 0), duration_s)) / duration_s;
  const bar = (/** @type {Span} */ [begin_s, end_s], /** @type {string} */ kind) =>
    svg("rect", { class: kind, x: share(begin_s), width: Math.max(share(end_s) - share(begin_s), 0.3), y: 0, height: LANE });
  const lane = (/** @type {[string, Span[]]} */ [name, spans]) => h("div", { class: "lane" }, h("span", null, name),
    svg("svg", { viewBox: `0 0 100 ${LANE}`, preserveAspectRatio: "none", role: "img", "aria-label": `${name}: ${spokenSpans(spans)}` },
      bar([0, duration_s], "gap"), spans.map((span) => bar(span, "there")),
      bar([0, from_s], "off"), bar([until_s, duration_s], "off")));
  return h("div", { class: "course" }, lanes.map(lane));
}

/** @param {Span[]} spans */
function spokenSpans(spans) {
  return spans.map(([from_s, until_s]) => t("{{low}} to {{high}}", { low: formatMoment(from_s), high: formatMoment(until_s) })).join(", ") || t("none");
}

/** A time line on which both ends can be moved: fields `from_s` and `until_s` of a form.
 * @param {Course} course @param {Span} [given] what was chosen before */
export function stretchField(course, given = [0, course.duration_s]) {
  const { duration_s } = course;
  let chosen = given;
  let lanes = courseLanes(course, chosen);
  const ends = [["from", t("From"), 0], ["until", t("Until"), 1]].map(([end, words, at]) => {
    const input = h("input", { type: "range", name: `${end}_s`, min: "0", max: String(duration_s), step: String(STEP_S) });
    const told = h("span", { class: "figures", "aria-hidden": "true" });
    return { end: /** @type {"from" | "until"} */ (end), at: Number(at), input, told, label: h("label", { class: "field" }, h("span", null, words, " ", told), input) };
  });
  const show = () => {
    for (const { at, input, told } of ends) {
      input.value = String(chosen[at]);
      input.setAttribute("aria-valuetext", formatMoment(chosen[at]));
      told.textContent = formatMoment(chosen[at]);
    }
    const now = courseLanes(course, chosen);
    lanes.replaceWith(now);
    lanes = now;
  };
  const body = h("fieldset", { class: "stretch" }, h("legend", null, t("Which part of it")), lanes, ends.map(({ label }) => label),
    h("small", null, t("The recording stays whole; only what lies between is mapped.")));
  for (const { end, at, input } of ends) {
    input.addEventListener("input", () => {
      const moved = /** @type {Span} */ ([...chosen]);
      moved[at] = Number(input.value);
      chosen = apart(moved, end, duration_s);
      show();
    });
  }
  show();
  return body;
}

// On the page of a map: what its recording has along its time, what is missing, and mapping it again.

/** @typedef {import("./store.js").Map_} Map_ */

/** Hidden for a map of several walks, and where the recording is gone and lacked nothing.
 * @param {Map_} map @param {Recording | undefined} recording @param {() => void} again */
export function recordedPart({ kind, facts }, recording, again) {
  const missing = /** @type {import("../shared/format.js").Missing[]} */ (facts?.missing ?? []);
  if (kind !== "run" || (!recording && missing.length === 0)) return h("section", { hidden: true });
  const kept = keptOf(facts);
  const course = recording ? courseOf(recording) : null;
  const words = kept ? t("Mapped from {{from}} to {{until}}.", { from: formatMoment(kept[0]), until: untilWords(kept[1], course?.duration_s) }) : t("All of it is mapped.");
  return part(t("Recording"), [
    course && courseLanes(course, kept ?? undefined),
    h("p", { class: "soft" }, words),
    missing.length > 0 && h("ul", { class: "missing" }, missing.map((each) => h("li", null, missingLine(each)))),
    recording && h("button", { type: "button", class: "button", click: again }, icon("again"), t("Trim and map again"))]);
}

/** The stretch that a map was made of; null where that is all. @param {any} facts @returns {Span | null} */
export function keptOf(facts) {
  const kept = facts?.kept_s;
  return Array.isArray(kept) && kept.length === 2 ? [Number(kept[0]), Number(kept[1])] : null;
}

/** @param {number} until_s @param {number | undefined} duration_s */
function untilWords(until_s, duration_s) {
  return until_s < (duration_s ?? 1e6) ? formatMoment(until_s) : t("the end");
}

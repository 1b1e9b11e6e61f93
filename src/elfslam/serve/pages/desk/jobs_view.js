// The jobs: what the server is doing, and what went wrong.

import { requestJson } from "../shared/api.js";
import { orSay } from "./dialogs.js";
import { h } from "../shared/dom.js";
import { formatAgo, formatDuration, formatShare, missingWords, secondsBetween, stageWords } from "../shared/format.js";
import {
  cell, emptyPage, headOf, iconButton, matching, nothingFound, rowHead, sorted, stateCell, tableOf, toolbarOf,
} from "./lists.js";
import { isOpen, jobTitle } from "./store.js";
import { counted, t, translated } from "../shared/words.js";

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

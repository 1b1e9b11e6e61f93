// The jobs: what the server is doing, and what went wrong.

import { askJson } from "./api.js";
import { orSay } from "./dialogs.js";
import { h } from "../shared/dom.js";
import { missingWords } from "../shared/missing.js";
import { matching, sorted } from "./finding.js";
import { formatAgo, formatDuration, formatShare, plural, secondsBetween } from "./format.js";
import { cell, emptyPage, headOf, iconButton, rowHead, tableOf } from "./parts.js";
import { isOpen, jobTitle } from "./store.js";
import { nothingFound, toolbarOf } from "./toolbar.js";

/** @typedef {import("./store.js").Job} Job */
/** @typedef {import("./store.js").Known} Known */
/** @typedef {import("./main.js").Desk} Desk */

const COLUMNS = ["Job", "State", "Asked", "Took", "Actions"];
const KINDS = { map: "Map", merge: "Merge", locate: "Locate" };

/** @type {Record<string, [string, string]>} */
const STATES = {
  queued: ["Waiting", "wait"], running: ["Running", "wait"], done: ["Done", "pass"],
  failed: ["Failed", "fail"], cancelled: ["Cancelled", "wait"],
};

/** @param {Desk} desk */
export function jobsView({ known, orders, nowMs }) {
  const order = orders.jobs;
  const open = known.jobs.filter(isOpen).length;
  const words = open > 0 ? `${plural(open, "job")} to do. The server goes on when this page is closed.` : "Nothing to do at the moment.";
  const named = known.jobs.map((job) => ({ job, name: jobTitle(job, known), created_utc: job.created_utc }));
  const found = matching(named, order.find, ({ job, name }) => [name, KINDS[job.kind], STATES[job.state]?.[0], job.problem]);
  const rows = sorted(found, order.by, () => null).map(({ job }) => rowOf(job, known, nowMs()));
  const all = known.jobs.length;
  return h("div", { class: "page" }, headOf("Jobs", words),
    all > 1 && toolbarOf("Jobs", order, ["newest", "oldest", "name"], { shown: rows.length, all }),
    rows.length > 0 ? tableOf("Jobs", COLUMNS, rows)
      : all > 0 ? nothingFound(order.find) : emptyPage(known, "again", "No jobs yet", "Mapping, merging and locating show up here."));
}

/** @param {Job} job @param {Known} known @param {number} nowMs */
function rowOf(job, known, nowMs) {
  const title = jobTitle(job, known);
  const took_s = job.started_utc ? secondsBetween(job.started_utc, job.finished_utc, nowMs) : null;
  return h("tr", { "data-key": job.id, role: "row" },
    rowHead(h("span", { class: "kind" }, KINDS[job.kind] ?? job.kind), h("strong", null, title),
      job.attempts > 1 && h("small", null, `attempt ${job.attempts}`)),
    cell("State", stateOfJob(job)),
    cell("Asked", h("time", { datetime: job.created_utc, title: job.created_utc }, formatAgo(job.created_utc, nowMs))),
    cell("Took", formatDuration(took_s)),
    h("td", { class: "actions", role: "cell" }, outcomeLink(job, known),
      isOpen(job) && iconButton("stop", "cancel", job.id, `Cancel ${title}`),
      (job.state === "failed" || job.state === "cancelled") && iconButton("again", "retry", job.id, `Retry ${title}`)));
}

/** @param {Job} job @param {Known} known */
function outcomeLink(job, { maps }) {
  const shown = job.kind === "locate" ? job.given.map : job.gave?.map;
  if (isOpen(job) || !maps.some(({ id }) => id === shown)) return null;
  return h("a", { class: "button small", href: `#/maps/${encodeURIComponent(shown)}` }, "See it");
}

/** Badge, progress and what it is at, or the one line of what went wrong. @param {Job} job */
export function stateOfJob(job) {
  if (job.state === "running") {
    const known = job.share !== null;
    const bar = h("progress", { max: 1, value: known ? job.share : null, "aria-label": "Progress" });
    return h("div", { class: "doing" }, bar, h("small", null, h("span", { class: "figures" }, formatShare(job.share)), ` ${job.doing || "starting"}`));
  }
  const [words, verdict] = STATES[job.state] ?? [job.state, "wait"];
  const lacks = missingWords(job.gave?.missing, 1);
  return [h("span", { class: "badge", "data-verdict": verdict }, words), lacks && h("small", { class: "lacks" }, lacks),
    job.problem && job.state !== "done" && h("small", { class: "problem" }, job.problem)];
}

/** @param {Desk} desk */
export function jobActions(desk) {
  const send = (/** @type {string} */ verb) => async (/** @type {string} */ id) => {
    await orSay(() => askJson(`/api/jobs/${encodeURIComponent(id)}/${verb}`, { method: "POST" }));
    await desk.now();
  };
  return { cancel: send("cancel"), retry: send("retry") };
}

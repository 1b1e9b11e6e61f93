// How the walks of a floor map fit together: which share places, and which were refused.

import { h } from "../shared/dom.js";
import { formatNumber, withoutMarks } from "../shared/format.js";
import { stageWords } from "../shared/job_words.js";
import { part } from "./viewer/panel.js";
import { t, translated } from "../shared/words.js";

/** @typedef {{one: string, other: string, places: number, resemblance: number | null, outcome: string}} Pair */

/** Nothing for the map of a single walk. @param {import("./store.js").Map_} map @returns {any[]} */
export function meetingPart({ facts }) {
  const pairs = /** @type {Pair[]} */ (Array.isArray(facts?.pairs) ? facts.pairs : []);
  const refused = Object.entries(facts?.refused ?? {});
  if (pairs.length === 0 && refused.length === 0) return [];
  const names = [...new Set([...pairs.flatMap(({ one, other }) => [one, other]), ...refused.map(([name]) => name)])];
  const shown = withoutMarks(names);
  const head = [t("Walks"), t("Places"), t("Similarity"), t("Outcome")].map((name) => h("th", { scope: "col" }, name));
  const rows = pairs.map(({ one, other, places, resemblance, outcome }) => h("tr", null,
    h("th", { scope: "row" }, t("{{one}} and {{other}}", { one: String(shown.get(one)), other: String(shown.get(other)) })), h("td", null, String(places)),
    h("td", null, Number.isFinite(resemblance) ? formatNumber(Number(resemblance), 2) : "–"), h("td", null, stageWords(outcome))));
  return [part(t("How the walks fit together"), [
    h("div", { class: "scroll" }, h("table", { class: "meetings", "aria-label": t("How the walks fit together") }, h("thead", null, h("tr", null, head)), h("tbody", null, rows))),
    refused.map(([name, why]) => h("p", { class: "problem" }, `${shown.get(name)}: ${translated(why)}`))])];
}

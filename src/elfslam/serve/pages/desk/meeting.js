// How the walks of a floor map fit together: which share places, and which were refused.

import { h } from "../shared/dom.js";
import { withoutMarks } from "./format.js";
import { part } from "./viewer/panel.js";

/** @typedef {{one: string, other: string, places: number, resemblance: number | null, outcome: string}} Pair */

/** Nothing for the map of a single walk. @param {import("./store.js").Map_} map @returns {any[]} */
export function meetingPart({ facts }) {
  const pairs = /** @type {Pair[]} */ (Array.isArray(facts?.pairs) ? facts.pairs : []);
  const refused = Object.entries(facts?.refused ?? {});
  if (pairs.length === 0 && refused.length === 0) return [];
  const names = [...new Set([...pairs.flatMap(({ one, other }) => [one, other]), ...refused.map(([name]) => name)])];
  const shown = withoutMarks(names);
  const head = ["Walks", "Places", "Similarity", "Outcome"].map((name) => h("th", { scope: "col" }, name));
  const rows = pairs.map(({ one, other, places, resemblance, outcome }) => h("tr", null,
    h("th", { scope: "row" }, `${shown.get(one)} and ${shown.get(other)}`), h("td", null, String(places)),
    h("td", null, Number.isFinite(resemblance) ? Number(resemblance).toFixed(2) : "–"), h("td", null, outcome)));
  return [part("How the walks fit together", [
    h("div", { class: "scroll" }, h("table", { class: "meetings", "aria-label": "How the walks fit together" }, h("thead", null, h("tr", null, head)), h("tbody", null, rows))),
    refused.map(([name, why]) => h("p", { class: "problem" }, `${shown.get(name)}: ${why}`))])];
}

// The maps: of single walks, and of floors that were merged from them.

import { ask, askJson } from "./api.js";
import { askToMerge } from "./asking.js";
import { confirmDelete, orSay, say, showPerson } from "./dialogs.js";
import { downloadsOf } from "./downloads.js";
import { h } from "../shared/dom.js";
import { formatAgo, formatCount, formatMetres, plural } from "./format.js";
import { icon } from "../shared/icons.js";
import { cell, emptyPage, headOf, iconButton, rowHead, tableOf } from "./parts.js";
import { keptOf } from "./recorded.js";

/** @typedef {import("./store.js").Map_} Map_ */
/** @typedef {import("./main.js").Desk} Desk */

const COLUMNS = ["Chosen", "Map", "Of", "Length", "Passed again", "Made", "Actions"];

/** @param {Desk} desk */
export function mapsView({ known, chosen, nowMs }) {
  const rows = known.maps.map((map) => rowOf(map, chosen, nowMs()));
  const count = known.maps.filter(({ id }) => chosen.has(id)).length;
  const merge = h("button", { type: "button", class: "button primary", "data-action": "merge", "aria-disabled": String(count < 2), title: count < 2 ? "Choose two maps or more" : null },
    icon("layers"), count < 2 ? "Merge chosen maps" : `Merge ${count} maps`);
  return h("div", { class: "page" },
    headOf("Maps", "Choose several of one floor to merge them into one map.", known.maps.length > 1 && merge),
    rows.length > 0 ? tableOf("Maps", COLUMNS, rows)
      : emptyPage(known, "map", "No maps yet", "A recording becomes a map as soon as it has arrived."));
}

/** @param {Map_} map @param {Set<string>} chosen @param {number} nowMs */
function rowOf(map, chosen, nowMs) {
  const { id, name, kind, created_utc } = map;
  const address = `#/maps/${encodeURIComponent(id)}`;
  const facts = factsOf(map);
  const box = h("input", { type: "checkbox", "data-action": "choose", "data-id": id, "aria-label": `Choose ${name}`, checked: chosen.has(id) });
  return h("tr", { "data-key": id, role: "row" },
    h("td", { role: "cell", class: "chosen" }, h("label", null, box)),
    rowHead(h("a", { href: address }, name), map.floor_plan && h("small", null, "on a floor plan"), keptOf(map.facts) && h("small", null, "of a stretch of the recording")),
    cell("Of", kind === "floor" ? plural(facts.walks ?? map.sources.length, "walk") : "one walk"),
    cell("Length", formatMetres(facts.distance_m), facts.footsteps === null ? null : h("small", null, plural(facts.footsteps, "footstep"))),
    cell("Passed again", facts.closures === null ? "–" : formatCount(facts.closures)),
    cell("Made", h("time", { datetime: created_utc, title: created_utc }, formatAgo(created_utc, nowMs))),
    h("td", { class: "actions", role: "cell" },
      h("a", { class: "button small", href: address }, icon("map"), h("span", null, "Open", h("span", { class: "visually-hidden" }, ` ${name}`))),
      h("a", { class: "button icon", href: `/api/maps/${encodeURIComponent(id)}/report.html`, target: "_blank", rel: "noopener", "aria-label": `Report of ${name}`, title: "Report" }, icon("report")),
      iconButton("download", "downloads", id, `Downloads of ${name}`),
      iconButton("trash", "delete", id, `Delete ${name}`, "danger")));
}

/** The few numbers that a list shows, whichever of them are known. @param {Map_} map
 * @returns {Record<"footsteps" | "closures" | "walks" | "distance_m", number | null>} */
export function factsOf({ facts }) {
  const known = (/** @type {string} */ name) => (Number.isFinite(facts?.[name]) ? Number(facts[name]) : null);
  return { footsteps: known("footsteps"), closures: known("closures_kept") ?? known("closures"), walks: known("walks"), distance_m: known("distance_m") };
}

/** @param {Desk} desk */
export function mapActions(desk) {
  const found = (/** @type {string} */ id) => desk.known.maps.find((map) => map.id === id);
  return {
    choose(/** @type {string} */ id) {
      if (!desk.chosen.delete(id)) desk.chosen.add(id);
      desk.render();
    },
    async merge() {
      const maps = desk.known.maps.filter(({ id }) => desk.chosen.has(id));
      const job = await askToMerge(maps);
      if (!job) return;
      const well = await orSay(() => askJson("/api/jobs", { method: "POST", json: job }));
      if (well) {
        desk.chosen.clear();
        say("The maps are being merged; see Jobs.");
      }
      await desk.now();
    },
    async downloads(/** @type {string} */ id) {
      const map = found(id);
      if (map) await orSay(async () => showPerson(`Downloads of ${map.name}`, await downloadsOf(map)));
    },
    async delete(/** @type {string} */ id) {
      const map = found(id);
      if (map && (await deleteMap(map))) await desk.now();
    },
  };
}

/** @param {Map_} map @returns {Promise<boolean>} whether it is gone */
export async function deleteMap(map) {
  const words = "The map, its report and its floor plan leave this server and cannot be brought back. The recordings stay.";
  if (!(await confirmDelete(map.name, words))) return false;
  return orSay(() => ask(`/api/maps/${encodeURIComponent(map.id)}`, { method: "DELETE" }));
}

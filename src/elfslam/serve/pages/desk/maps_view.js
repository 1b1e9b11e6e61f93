// The maps, by venue and floor: of single walks, and of floors that were merged from them; one's own and shared ones.

import { download, request, requestJson } from "../shared/api.js";
import { h, icon } from "../shared/dom.js";
import { fileName, formatAgo, formatCount, formatMetres } from "../shared/format.js";
import { grouped } from "../shared/places.js";
import { counted, t } from "../shared/words.js";
import { askToMerge, confirmDelete, orSay, say, showPerson } from "./dialogs.js";
import {
  cell,
  chooseCell,
  chosenOf,
  deleteChosen,
  emptyPage,
  headOf,
  iconButton,
  lengthCell,
  matching,
  nothingFound,
  renameMap,
  renamePlace,
  rowHead,
  sorted,
  tableInGroups,
  toolbarOf,
} from "./lists.js";
import { leaveMap, ownerBadge, shareMap, sharedWords } from "./sharing.js";
import { keptOf } from "./jobs_view.js";

/** @typedef {import("./store.js").Map_} Map_ */
/** @typedef {import("./main.js").Desk} Desk */

const COLUMNS = [t("Chosen"), t("Map"), t("Of"), t("Length"), t("Passed again"), t("Made"), t("Actions")];
const GONE = t("Maps, their reports and floor plans leave this server, also for those whom they are shared with, and cannot be brought back. The recordings stay.");

/** @param {Desk} desk */
export function mapsView({ known, chosen, orders, nowMs }) {
  const order = orders.maps;
  const shown = shownMaps(known.maps, order);
  const mine = chosenOf(shown, chosen).filter(({ right }) => right === "own");
  const editable = chosenOf(shown, chosen).filter(({ right }) => right !== "read");
  const groups = grouped(shown);
  const bodies = groups.map((group, at) => [...headingsOf(groups, at), ...group.things.map((map) => rowOf(map, chosen, nowMs()))]);
  return h("div", { class: "page" },
    headOf(t("Maps"), t("Yours, and those that others share with you. Choose several of one floor to merge them into one map."), known.maps.length > 1 && mergeButton(editable.length)),
    known.maps.length > 1 && toolbarOf(t("Maps"), order, ["newest", "oldest", "name", "longest"], { shown: shown.length, all: known.maps.length, chosen: deleteChosen(mine.length) }),
    shown.length > 0 ? tableInGroups(t("Maps"), COLUMNS, bodies)
      : known.maps.length > 0 ? nothingFound(order.find)
        : emptyPage(known, "map", t("No maps yet"), t("A recording becomes a map as soon as it has arrived.")));
}

/** @param {Map_[]} maps @param {import("./lists.js").Order} order */
function shownMaps(maps, { find, by }) {
  const found = matching(maps, find, ({ name, venue, floor, owner, right }) => [name, venue, floor, right === "own" ? "" : owner]);
  return sorted(found, by, (map) => factsOf(map).distance_m);
}

/** @param {number} count */
function mergeButton(count) {
  return h("button", { type: "button", class: "button primary", "data-action": "merge", "aria-disabled": String(count < 2), title: count < 2 ? t("Choose two maps or more that you may change") : null },
    icon("layers"), count < 2 ? t("Merge chosen maps") : counted(count, "Merge {{count}} map", "Merge {{count}} maps"));
}

/** Headings among the rows: of a venue before its first floor, and of each floor; none where no map lies anywhere.
 * @param {{venue: string | null, floor: string | null, things: Map_[]}[]} groups @param {number} at */
function headingsOf(groups, at) {
  const { venue, floor, things } = groups[at];
  if (groups.every((group) => group.venue === null)) return [];
  const editable = venue !== null && things.some(({ right }) => right !== "read");
  const isFirst = at === 0 || groups[at - 1].venue !== venue;
  return [
    isFirst && headingRow("h2", venue ?? t("Not on a floor yet"), editable ? [venue, null] : null, things.some(isDemonstration)),
    floor !== null && headingRow("h3", floor, editable ? [venue, floor] : null),
  ];
}

/** @param {"h2" | "h3"} level @param {string} words @param {(string | null)[] | null} place what can be renamed
 * @param {boolean} [isRemoved] what goes again in one click */
function headingRow(level, words, place, isRemoved) {
  const key = JSON.stringify(place ?? words);
  return h("tr", { class: `group ${level}`, "data-key": `group-${level}-${key}`, role: "row" },
    h("th", { scope: "rowgroup", role: "rowheader", colspan: COLUMNS.length },
      h("div", null, h(level, null, words), place && iconButton("edit", "rename-place", key, t("Rename {{name}}", { name: words })),
        isRemoved && h("button", { type: "button", class: "button small", "data-action": "remove-demonstration" }, icon("trash"), t("Remove")))));
}

/** @param {Map_} map @param {Set<string>} chosen @param {number} nowMs */
function rowOf(map, chosen, nowMs) {
  const { id, name, kind, created_utc, right } = map;
  const address = `#/maps/${encodeURIComponent(id)}`;
  const facts = factsOf(map);
  const words = [map.floor_plan && t("on a floor plan"), keptOf(map.facts) && t("of a stretch of the recording"), sharedWords(map)].filter(Boolean).join(" · ");
  return h("tr", { "data-key": id, role: "row" },
    chooseCell(id, name, chosen.has(id)),
    rowHead(h("a", { href: address }, name), (right !== "own" || words) && h("span", { class: "marks" }, ownerBadge(map), words && h("small", null, words))),
    cell(t("Of"), kind === "floor" ? counted(facts.walks ?? map.sources.length, "{{count}} walk", "{{count}} walks") : t("one walk")),
    lengthCell(formatMetres(facts.distance_m), facts.footsteps === null ? null : h("small", null, counted(facts.footsteps, "{{count, number}} footstep", "{{count, number}} footsteps"))),
    cell(t("Passed again"), facts.closures === null ? "–" : formatCount(facts.closures)),
    cell(t("Made"), h("time", { datetime: created_utc, title: created_utc }, formatAgo(created_utc, nowMs))),
    h("td", { class: "actions", role: "cell" },
      h("a", { class: "button small", href: address }, icon("map"), h("span", null, t("Open"), h("span", { class: "visually-hidden" }, ` ${name}`))),
      h("a", { class: "button icon", href: `/api/maps/${encodeURIComponent(id)}/report.html`, target: "_blank", rel: "noopener", "aria-label": t("Report of {{name}}", { name }), title: t("Report") }, icon("report")),
      iconButton("download", "downloads", id, t("Downloads of {{name}}", { name })),
      right !== "read" && iconButton("edit", "rename", id, t("Rename {{name}}", { name })),
      right === "own" && iconButton("share", "share", id, t("Share {{name}}", { name })),
      right === "own" ? iconButton("trash", "delete", id, t("Delete {{name}}", { name }), "danger") : iconButton("leave", "leave", id, t("Take {{name}} off my list", { name }))));
}

/** Whether a map is of the demonstration building. @param {{facts: any}} map */
export const isDemonstration = ({ facts }) => Boolean(facts?.demonstration);

/** The few numbers that a list shows, whichever of them are known. @param {{facts: any}} map
 * @returns {Record<"footsteps" | "closures" | "walks" | "distance_m", number | null>} */
export function factsOf({ facts }) {
  const known = (/** @type {string} */ name) => (Number.isFinite(facts?.[name]) ? Number(facts[name]) : null);
  return { footsteps: known("footsteps"), closures: known("closures_kept") ?? known("closures"), walks: known("walks"), distance_m: known("distance_m") };
}

/** @param {Desk} desk */
export function mapActions(desk) {
  /** Does something with a map, and looks again. @param {(map: Map_) => Promise<unknown>} deed */
  const on = (deed) => async (/** @type {string} */ id) => {
    const map = desk.known.maps.find((each) => each.id === id);
    if (map && (await deed(map))) await desk.now();
  };
  const chosen = () => chosenOf(shownMaps(desk.known.maps, desk.orders.maps), desk.chosen);
  return {
    async merge() {
      const job = await askToMerge(chosen().filter(({ right }) => right !== "read"));
      if (!job) return;
      const well = await orSay(() => requestJson("/api/jobs", { method: "POST", json: job }));
      if (well) {
        desk.chosen.clear();
        say(t("The maps are being merged; see Jobs."));
      }
      await desk.now();
    },
    downloads: on(async (map) => {
      await orSay(async () => showPerson(t("Downloads of {{name}}", { name: map.name }), await downloadsOf(map)));
    }),
    rename: on((map) => renameMap(map, desk.known.maps)),
    "rename-place": async (/** @type {string} */ told) => {
      const [venue, floor] = JSON.parse(told);
      if (await renamePlace(venue, floor)) await desk.now();
    },
    share: on(async (map) => {
      await shareMap(map);
      return true;
    }),
    leave: on(leaveMap),
    delete: on(deleteMap),
    async "remove-demonstration"() {
      await orSay(() => request("/api/demonstration", { method: "DELETE" }));
      await desk.now();
    },
    async "delete-chosen"() {
      const maps = chosen().filter(({ right }) => right === "own");
      if (!(await confirmDelete(counted(maps.length, "{{count}} map", "{{count}} maps"), GONE, maps.map(({ name }) => name)))) return;
      await orSay(() => requestJson("/api/maps/delete", { method: "POST", json: { ids: maps.map(({ id }) => id) } }));
      await desk.now();
    },
  };
}

/** @param {Map_} map @returns {Promise<boolean>} whether it is gone */
export async function deleteMap(map) {
  if (!(await confirmDelete(map.name, GONE))) return false;
  return orSay(() => request(`/api/maps/${encodeURIComponent(map.id)}`, { method: "DELETE" }));
}

// What a map can be taken away as. What it does not hold is refused in the server's own words.

/** What each format is for. @type {Record<string, string>} */
const WORDS = {
  tum: t("TUM trajectory: a pose per line, for evo and other tools"),
  g2o: t("g2o pose graph: steps and closures, for other optimisers"),
  onnx: t("ONNX encoder: what others are located by"),
  geojson: t("GeoJSON: walks, spots and coverage on the Earth"),
  imdf: t("IMDF: the walked ground as a unit of a venue"),
  ros: t("ROS map: the walked ground as an image, for robots"),
  parquet: t("Parquet: the spots as a table"),
};

/** Formats that lie on the Earth. */
const PLACED = ["geojson", "imdf"];
const KEPT = "elfslam-export-";

/** What IMDF asks for beside the origin. @type {[string, string, string][]} */
const VENUE = [
  ["name", t("Venue"), ""], ["category", t("Category"), "businesscampus"], ["address", t("Address"), ""], ["locality", t("Town"), ""],
  ["country", t("Country, such as CH"), ""], ["level", t("Name of the level"), t("Ground floor")], ["ordinal", t("Level, 0 at the ground"), "0"],
];

/** What a format is asked for with: what was filled in. @param {string} format @param {Map<string, HTMLInputElement>} inputs */
export function queryOf(format, inputs) {
  const names = format === "imdf" ? ["origin", ...VENUE.map(([name]) => name)] : format === "geojson" ? ["origin"] : [];
  const given = names.map((name) => [name, inputs.get(name)?.value.trim() ?? ""]).filter(([, value]) => value !== "");
  return given.length > 0 ? `?${new URLSearchParams(given)}` : "";
}

/** What a map knows of the venue itself. @param {{venue?: string | null, floor?: string | null, level?: number | null}} map
 * @returns {Record<string, string>} */
export function venueOf({ venue, floor, level }) {
  const known = { name: venue, level: floor, ordinal: level };
  return Object.fromEntries(Object.entries(known).filter(([, told]) => told !== null && told !== undefined).map(([name, told]) => [name, String(told)]));
}

/** Everything of one map, ready for a dialog or a panel.
 * @param {{id: string, name: string, venue?: string | null, floor?: string | null, level?: number | null}} map */
export async function downloadsOf(map) {
  const path = `/api/maps/${encodeURIComponent(map.id)}`;
  /** @type {string[]} */
  const formats = await requestJson(`${path}/exports`);
  const known = venueOf(map);
  const inputs = new Map([["origin", keptInput("origin", "", undefined, "47.3769,8.5417,90")],
    ...VENUE.map(([name, , value]) => /** @type {[string, HTMLInputElement]} */ ([name, keptInput(name, value, known[name])]))]);
  return h("div", { class: "downloads" },
    h("div", { class: "row" },
      h("a", { class: "button", href: `${path}/report.html`, target: "_blank", rel: "noopener" }, icon("report"), t("Report")),
      h("a", { class: "button", href: `${path}/map.zip`, download: `${fileName(map.name)}.zip` }, icon("download"), t("Whole folder"))),
    h("ul", { class: "exports" }, formats.map((format) => exportLine(map, path, format, inputs))),
    formats.some((format) => PLACED.includes(format)) && h("label", { class: "field" },
      h("span", null, t("Where on the Earth")), inputs.get("origin"),
      h("small", null, t("Latitude, longitude and bearing of the map's x axis; GeoJSON and IMDF ask for it where the map has no place on the Earth."))),
    formats.includes("imdf") && h("details", null, h("summary", null, t("About the venue, for IMDF")),
      h("div", { class: "fields two" }, VENUE.map(([name, words]) => h("label", { class: "field" }, h("span", null, words), inputs.get(name))))));
}

/** A field that remembers, as long as the tab is open; what the map knows comes first. @param {string} name
 * @param {string} value @param {string} [known] @param {string} [placeholder] @returns {HTMLInputElement} */
function keptInput(name, value, known, placeholder) {
  const input = h("input", { name, placeholder, autocomplete: "off", spellcheck: "false" });
  input.value = known ?? sessionStorage.getItem(KEPT + name) ?? value;
  input.addEventListener("change", () => sessionStorage.setItem(KEPT + name, input.value.trim()));
  return input;
}

/** Whether all is told that IMDF wants of the venue; else the first field that is empty asks for it.
 * @param {Map<string, HTMLInputElement>} inputs */
function askedVenue(inputs) {
  const lacking = VENUE.map(([name]) => inputs.get(name)).find((input) => input?.value.trim() === "");
  if (!lacking) return true;
  /** @type {HTMLDetailsElement} */ (lacking.closest("details")).open = true;
  [lacking.required, lacking.value] = [true, ""];
  lacking.reportValidity();
  return false;
}

/** @param {{id: string, name: string}} map @param {string} path @param {string} format
 * @param {Map<string, HTMLInputElement>} inputs */
function exportLine(map, path, format, inputs) {
  const refusal = h("p", { class: "problem", role: "status" });
  const button = h("button", { type: "button", class: "button small", "data-format": format, "aria-label": t("Download as {{format}}", { format }) }, icon("download"), format);
  button.addEventListener("click", async () => {
    refusal.textContent = "";
    if (format === "imdf" && !askedVenue(inputs)) return;
    button.setAttribute("aria-busy", "true");
    try {
      await download(`${path}/exports/${encodeURIComponent(format)}${queryOf(format, inputs)}`, `${fileName(map.name)}.${format}`);
    } catch (problem) {
      refusal.textContent = problem instanceof Error ? problem.message : String(problem);
    }
    button.removeAttribute("aria-busy");
  });
  return h("li", null, button, h("div", null, h("span", null, WORDS[format] ?? ""), refusal));
}

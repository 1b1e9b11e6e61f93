// Above a list: what is searched for, what it is sorted by, and what is done with the chosen ones.

import { requestJson } from "../shared/api.js";
import { h, icon } from "../shared/dom.js";
import { byName, placeOf } from "../shared/places.js";
import { counted, inSentence, t } from "../shared/words.js";
import { askPerson, field, orSay } from "./dialogs.js";

/**
 * @param {string} title of the list @param {Order} order @param {Sort[]} sorts
 * @param {{shown: number, all: number, chosen?: any}} rows `chosen`: what can be done with those
 */
export function toolbarOf(title, order, sorts, { shown, all, chosen = null }) {
  const list = inSentence(title);
  const search = h("input", { type: "search", "data-order": "find", name: "find", value: order.find, placeholder: t("Search {{list}}", { list }), "aria-label": t("Search {{list}}", { list }), autocomplete: "off", spellcheck: "false" });
  const sort = h("select", { "data-order": "by", name: "by", "aria-label": t("Sort {{list}}", { list }) },
    sorts.map((by) => h("option", { value: by, selected: by === order.by }, SORTS[by])));
  return h("div", { class: "toolbar", role: "group", "aria-label": t("{{list}}: search, sort, choose", { list: title }) },
    h("div", { class: "search" }, icon("search"), search), sort,
    chosen && h("label", { class: "tick all" }, h("input", { type: "checkbox", "data-action": "choose-all" }), h("span", null, t("All"))),
    chosen,
    h("p", { class: "visually-hidden", role: "status" }, order.find ? counted(all, "{{shown}} of {{count}} row shown", "{{shown}} of {{count}} rows shown", { shown }) : ""));
}

/** The button that deletes what is chosen. @param {number} count */
export function deleteChosen(count) {
  return h("button", { type: "button", class: "button danger", "data-action": "delete-chosen", "aria-disabled": String(count === 0), title: count === 0 ? t("Choose some first") : null },
    icon("trash"), count === 0 ? t("Delete chosen") : t("Delete {{name}}", { name: count }));
}

/** In the place of a list in which nothing is found. @param {string} find */
export function nothingFound(find) {
  return h("div", { class: "empty" }, icon("search"), h("h2", null, t("Nothing found")), h("p", { class: "soft" }, t("Nothing here is called “{{name}}”.", { name: find.trim() })));
}

/** A box that chooses a row. @param {string} id @param {string} name @param {boolean} isChosen */
export function chooseCell(id, name, isChosen) {
  const box = h("input", { type: "checkbox", "data-action": "choose", "data-id": id, "aria-label": t("Choose {{name}}", { name }), checked: isChosen });
  return h("td", { role: "cell", class: "chosen" }, h("label", null, box));
}

/**
 * What a person ticked is no attribute: set it again. @param {ParentNode} root @param {Set<string>} chosen
 */
export function tickBoxes(root, chosen) {
  const boxes = /** @type {NodeListOf<HTMLInputElement>} */ (root.querySelectorAll('[data-action="choose"]'));
  for (const box of boxes) box.checked = chosen.has(box.dataset.id ?? "");
  const all = /** @type {HTMLInputElement | null} */ (root.querySelector('[data-action="choose-all"]'));
  if (!all) return;
  const count = [...boxes].filter(({ checked }) => checked).length;
  all.checked = boxes.length > 0 && count === boxes.length;
  all.indeterminate = count > 0 && count < boxes.length;
}

/** Choose a row or let it go; all that are shown, or none. @param {HTMLElement} root @param {Set<string>} chosen
 * @param {() => void} changed */
export function choosing(root, chosen, changed) {
  return {
    choose(/** @type {string} */ id) {
      if (!chosen.delete(id)) chosen.add(id);
      changed();
    },
    "choose-all"() {
      const boxes = /** @type {NodeListOf<HTMLInputElement>} */ (root.querySelectorAll('[data-action="choose"]'));
      const ids = [...boxes].map(({ dataset }) => dataset.id ?? "");
      const add = ids.some((id) => !chosen.has(id));
      for (const id of ids) if (add) chosen.add(id); else chosen.delete(id);
      changed();
    },
  };
}

// Which rows of a list are shown, and in which order. Pure.

/** @typedef {"newest" | "oldest" | "name" | "longest"} Sort */
/** @typedef {{find: string, by: Sort}} Order what somebody searches for, and what a list is sorted by */

/** @type {Record<Sort, string>} */
export const SORTS = { newest: t("Newest first"), oldest: t("Oldest first"), name: t("By name"), longest: t("Longest first") };

/** @returns {Order} */
export function firstOrder() {
  return { find: "", by: "newest" };
}

/** Letters without case and accents. @param {string} text */
function plain(text) {
  return text.normalize("NFD").replace(/\p{M}/gu, "").toLowerCase();
}

/** Those in which every word of a search stands. @template T @param {T[]} things @param {string} find
 * @param {(thing: T) => (string | null | undefined)[]} textsOf @returns {T[]} */
export function matching(things, find, textsOf) {
  const words = plain(find).split(/\s+/).filter(Boolean);
  if (words.length === 0) return things;
  return things.filter((thing) => {
    const text = plain(textsOf(thing).filter(Boolean).join(" "));
    return words.every((word) => text.includes(word));
  });
}

/** @template {{name: string, created_utc: string}} T @param {T[]} things @param {Sort} by
 * @param {(thing: T) => number | null | undefined} lengthOf @returns {T[]} */
export function sorted(things, by, lengthOf) {
  const newest = (/** @type {T} */ a, /** @type {T} */ b) => b.created_utc.localeCompare(a.created_utc);
  /** @type {Record<Sort, (a: T, b: T) => number>} */
  const orders = {
    newest,
    oldest: (a, b) => newest(b, a),
    name: (a, b) => byName(a.name, b.name) || newest(a, b),
    longest: (a, b) => (lengthOf(b) ?? -1) - (lengthOf(a) ?? -1) || newest(a, b),
  };
  return [...things].sort(orders[by]);
}

/** The chosen ones among those that are shown: what nobody sees is not acted on.
 * @template {{id: string}} T @param {T[]} shown @param {Set<string>} chosen @returns {T[]} */
export function chosenOf(shown, chosen) {
  return shown.filter(({ id }) => chosen.has(id));
}

/** What is there no more is not chosen any more. @param {Set<string>} chosen @param {{id: string}[]} there */
export function forgetGone(chosen, there) {
  const ids = new Set(there.map(({ id }) => id));
  for (const id of chosen) if (!ids.has(id)) chosen.delete(id);
}

// What the lists of the desk are made of.

/** @param {string} title @param {string} words @param {...any} actions */
export function headOf(title, words, ...actions) {
  return h("header", { class: "page-head" },
    h("div", null, h("h1", { tabindex: "-1" }, title), h("p", { class: "soft" }, words)),
    h("div", { class: "row" }, actions));
}

/** A table that says so even where narrow screens lay its rows out as cards.
 * @param {string} name @param {string[]} columns @param {any[]} rows */
export function tableOf(name, columns, rows) {
  return tableInGroups(name, columns, [rows]);
}

/** The same, its rows in several bodies. @param {string} name @param {string[]} columns @param {any[][]} bodies */
export function tableInGroups(name, columns, bodies) {
  const head = columns.map((column) => h("th", { scope: "col", role: "columnheader", class: column === t("Actions") ? "actions" : null },
    column === t("Actions") || column === t("Chosen") ? h("span", { class: "visually-hidden" }, column) : column));
  return h("table", { class: "list", role: "table", "aria-label": name },
    h("thead", { role: "rowgroup" }, h("tr", { role: "row" }, head)),
    bodies.map((rows) => h("tbody", { role: "rowgroup" }, rows)));
}

/** @param {string} label @param {...any} children */
export function cell(label, ...children) {
  return h("td", { role: "cell", "data-label": label }, h("div", null, children));
}

/** The state of a thing: as wide as it needs. @param {...any} children */
export function stateCell(...children) {
  return h("td", { role: "cell", class: "state", "data-label": t("State") }, h("div", null, children));
}

/** How long a thing is. @param {...any} children */
export function lengthCell(...children) {
  return h("td", { role: "cell", class: "length", "data-label": t("Length") }, h("div", null, children));
}

/** @param {...any} children */
export function rowHead(...children) {
  return h("th", { scope: "row", role: "rowheader" }, h("div", null, children));
}

/** @param {Parameters<typeof icon>[0]} picture @param {string} action @param {string} id
 * @param {string} label @param {string} [kind] */
export function iconButton(picture, action, id, label, kind = "") {
  return h("button", { type: "button", class: `button icon ${kind}`.trim(), "data-action": action, "data-id": id, "aria-label": label, title: label }, icon(picture));
}

/** A small button of a picture that does something. @param {Parameters<typeof icon>[0]} picture @param {string} label
 * @param {() => unknown} click @param {string} [kind] */
export function smallButton(picture, label, click, kind = "") {
  return h("button", { type: "button", class: `button icon small ${kind}`.trim(), "aria-label": label, title: label, click }, icon(picture));
}

/** @param {{loaded: boolean}} known @param {Parameters<typeof icon>[0]} picture @param {string} title
 * @param {any} words @param {any} [action] */
export function emptyPage(known, picture, title, words, action = null) {
  if (!known.loaded) return h("div", { class: "empty", "aria-busy": "true" }, h("p", { class: "soft" }, t("Asking the server…")));
  return h("div", { class: "empty" }, icon(picture), h("h2", null, title), h("p", { class: "soft" }, words), action);
}

// New names: of recordings, of maps and where they lie, of venues and floors, of oneself.

/** @typedef {import("./store.js").Map_} Map_ */

const MOST_CHARACTERS = "120";

/** @param {string} words @param {string} name @param {string | null} value @param {Record<string, any>} [more] */
function nameField(words, name, value, more = {}) {
  return field(words, { name, value: value ?? "", maxlength: MOST_CHARACTERS, autocomplete: "off", ...more });
}

/** One question, and its answer sent; whether it went well. @param {{title: string, body: any, path: string,
 * method?: string, json: (answer: FormData) => unknown}} question */
async function change({ title, body, path, method = "PATCH", json }) {
  const answer = await askPerson({ title, body, submit: t("Save") });
  return answer !== null && orSay(() => requestJson(path, { method, json: json(answer) }));
}

/** @param {FormData} answer @param {string} name */
const told = (answer, name) => String(answer.get(name) ?? "").trim();

/** @param {{id: string, name: string}} recording @returns {Promise<boolean>} */
export function renameRecording({ id, name }) {
  return change({
    title: t("Rename {{name}}", { name }),
    body: nameField(t("Name"), "name", name, { required: true }),
    path: `/api/recordings/${encodeURIComponent(id)}`,
    json: (answer) => ({ name: told(answer, "name") }),
  });
}

/** The name of a map, and where it lies. @param {Map_} map @param {Map_[]} maps whose venues and floors are offered
 * @returns {Promise<boolean>} */
export function renameMap(map, maps) {
  const offered = (/** @type {"venue" | "floor"} */ what) =>
    [...new Set(maps.map((each) => each[what]).filter((each) => each !== null))].sort(byName);
  const choices = (/** @type {string} */ id, /** @type {string[]} */ names) =>
    h("datalist", { id }, names.map((value) => h("option", { value })));
  return change({
    title: t("Name and place"),
    body: [
      nameField(t("Name"), "name", map.name, { required: true }),
      nameField(t("Venue"), "venue", map.venue, { list: "known-venues", placeholder: t("North Mall") }),
      nameField(t("Floor"), "floor", map.floor, { list: "known-floors", placeholder: t("Ground floor") }),
      choices("known-venues", offered("venue")), choices("known-floors", offered("floor")),
      h("small", null, t("Lists and phones group maps by venue and floor. Floors are ordered by the number in their name.")),
    ],
    path: `/api/maps/${encodeURIComponent(map.id)}`,
    json: (answer) => mapChange(told(answer, "name"), told(answer, "venue"), told(answer, "floor")),
  });
}

/** @param {string} name @param {string} venue @param {string} floor */
export function mapChange(name, venue, floor) {
  return { name, venue: venue || null, floor: floor || null };
}

/** A venue, or one floor of it. @param {string} venue @param {string | null} floor @returns {Promise<boolean>} */
export function renamePlace(venue, floor) {
  return change({
    title: t("Rename {{name}}", { name: placeOf({ venue, floor }) }),
    body: [
      nameField(floor === null ? t("Venue") : t("Floor"), "name", floor ?? venue, { required: true }),
      h("small", null, t("For every map there that you may change. Maps that others only let you see keep their place.")),
    ],
    path: "/api/places",
    json: (answer) => ({ venue, floor, name: told(answer, "name") }),
  });
}

/** @param {string} name @returns {Promise<boolean>} */
export function renameMe(name) {
  return change({
    title: t("Your name"),
    body: [nameField(t("Name"), "name", name, { required: true }), h("small", null, t("Others read it where you share a map with them."))],
    path: "/api/me",
    json: (answer) => ({ name: told(answer, "name") }),
  });
}

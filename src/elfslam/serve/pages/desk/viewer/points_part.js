// The rooms, doors and other places of a map that have a name: their list beside it, and how one is named, moved or
// forgotten.

import { Problem, requestJson } from "../../shared/api.js";
import { askPerson, confirmDelete, field, orSay } from "../dialogs.js";
import { smallButton } from "../lists.js";
import { h, icon } from "../../shared/dom.js";
import { KIND_WORDS } from "../../shared/map/points_of_interest.js";
import { byName } from "../../shared/places.js";
import { part } from "./panel.js";
import { t } from "../../shared/words.js";

/** @typedef {import("../../shared/map/points_of_interest.js").PointOfInterest} PointOfInterest */
/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("./state.js").State} State */

const MOST_CHARACTERS = "80";
const CHANGED_MEANWHILE = 409;

/**
 * @param {string} mapId @param {State} state
 * @param {{canEdit: () => boolean, redraw: () => void, changed: () => void}} told `changed` when the list is another
 */
export function pointsOf(mapId, state, { canEdit, redraw, changed }) {
  const path = `/api/maps/${encodeURIComponent(mapId)}/points-of-interest`;
  let version = "";
  /** @type {HTMLElement | null} */
  let nameButton = null;
  const bar = h("div", { class: "tie-bar", hidden: true }, h("p", { role: "status" }, t("Tap the place on the map.")),
    h("button", { type: "button", class: "button small", click: () => tap([state.view.x_m, state.view.y_m]) }, t("Type where it is")),
    h("button", { type: "button", class: "button small", click: () => turn(false) }, t("Cancel")));

  async function load() {
    take(await requestJson(path));
  }

  /** @param {{version: string, points: PointOfInterest[]}} now */
  function take(now) {
    version = now.version;
    state.points = now.points;
    changed();
  }

  /** @param {PointOfInterest[]} points */
  const save = (points) => orSay(async () => {
    try {
      take(await requestJson(path, { method: "PUT", json: { version, points } }));
    } catch (problem) {
      if (problem instanceof Problem && problem.status === CHANGED_MEANWHILE) await load();
      throw problem;
    }
  });

  /** Whether the next tap on the map names a place. @param {boolean} naming */
  function turn(naming) {
    state.naming = naming;
    if (naming) {
      state.layers.points = true;
      state.tie = null;
      state.placing = false;
    }
    changed();
    if (naming) bar.closest(".stage")?.scrollIntoView({ block: "nearest" });
  }

  /** @param {Point} xy_m */
  async function tap([x_m, y_m]) {
    turn(false);
    const made = await askPlace(t("Name this place"), { name: "", kind: "room", x_m, y_m });
    if (made) await save([...state.points, made]);
    nameButton?.focus(); // the list was made anew, and the button with it
  }

  /** @param {PointOfInterest} point */
  async function edit(point) {
    const made = await askPlace(t("Change {{name}}", { name: point.name }), point);
    if (made) await save(state.points.map((each) => (each === point ? made : each)));
  }

  /** @param {PointOfInterest} point */
  async function remove(point) {
    if (!(await confirmDelete(point.name, t("The name leaves this map; walks and recordings stay.")))) return;
    await save(state.points.filter((each) => each !== point));
  }

  /** @param {PointOfInterest} point */
  function row(point) {
    const { name, kind } = point;
    const line = h("li", null, h("span", null, name, h("small", null, ` ${KIND_WORDS[kind]}`)),
      canEdit() && [smallButton("edit", t("Change {{name}}", { name }), () => edit(point)), smallButton("trash", t("Delete {{name}}", { name }), () => remove(point), "danger")]);
    const stand = (/** @type {PointOfInterest | null} */ chosen) => () => {
      state.point = chosen;
      redraw();
    };
    line.addEventListener("pointerenter", stand(point));
    line.addEventListener("pointerleave", stand(null));
    return line;
  }

  function body() {
    bar.hidden = !state.naming;
    const sorted = [...state.points].sort((one, other) => byName(one.name, other.name));
    nameButton = h("button", { type: "button", class: "button", click: () => turn(true) }, icon("plus"), t("Name a place"));
    return [sorted.length > 0 ? h("ul", { class: "points" }, sorted.map(row)) : h("p", { class: "soft" }, t("Rooms, doors and lifts get a name here: phones tell how far it is to them, and exports carry them.")),
      canEdit() && h("div", { class: "row" }, nameButton)];
  }

  return { load, tap, bar, part: () => part(t("Named places"), body(), "part-points") };
}

/** @param {string} title @param {PointOfInterest} point @returns {Promise<PointOfInterest | null>} */
async function askPlace(title, { name, kind, x_m, y_m }) {
  const metres = (/** @type {string} */ words, /** @type {string} */ axis, /** @type {number} */ value) =>
    field(words, { name: axis, type: "number", step: "0.01", value: value.toFixed(2), inputmode: "decimal", required: true });
  const kinds = Object.entries(KIND_WORDS).map(([value, words]) => h("option", { value, selected: value === kind }, words));
  const answer = await askPerson({
    title,
    body: [field(t("Name"), { name: "name", value: name, maxlength: MOST_CHARACTERS, required: true, autocomplete: "off" }),
      h("label", { class: "field" }, h("span", null, t("Kind")), h("select", { name: "kind" }, kinds)),
      h("div", { class: "fields two" }, metres(t("x, m"), "x_m", x_m), metres(t("y, m"), "y_m", y_m))],
    submit: t("Save"),
  });
  const told = (/** @type {string} */ what) => String(answer?.get(what) ?? "").trim();
  return answer && { name: told("name"), kind: /** @type {any} */ (told("kind")), x_m: Number(told("x_m")), y_m: Number(told("y_m")) };
}

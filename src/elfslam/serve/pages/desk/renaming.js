// New names: of recordings, of maps and where they lie, of venues and floors, of oneself.

import { requestJson } from "../shared/api.js";
import { askPerson, field, orSay } from "./dialogs.js";
import { h } from "../shared/dom.js";
import { byName, placeOf } from "../shared/places.js";
import { t } from "../shared/words.js";

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

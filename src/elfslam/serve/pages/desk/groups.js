// Groups of people with whom maps are shared at once: a new one, who is in it, and its end.

import { request, requestJson } from "../shared/api.js";
import { field } from "./asking.js";
import { askPerson, confirmDelete, orSay } from "./dialogs.js";
import { h } from "../shared/dom.js";
import { counted, t } from "../shared/words.js";

/** @typedef {{id: string, name: string}} Person */
/** @typedef {{id: string, name: string, members: Person[]}} Group */

const MOST_CHARACTERS = "120";

/** @returns {Promise<Group[]>} */
export const loadGroups = () => requestJson("/api/groups");

/** @param {Group} group */
export function sizeOf({ members }) {
  return counted(members.length, "{{count}} person", "{{count}} people");
}

/** A group made or changed, once a person said how; null where nothing came of it.
 * @param {Person[]} people of this server @param {Group | null} group a new one where it is null
 * @returns {Promise<Group | null>} */
export async function askGroup(people, group) {
  const inside = new Set(group?.members.map(({ id }) => id));
  const tick = (/** @type {Person} */ { id, name }) => {
    const input = h("input", { type: "checkbox", name: "member", value: id });
    input.checked = inside.has(id);
    return h("label", { class: "tick" }, input, h("span", null, name));
  };
  const answer = await askPerson({
    title: group ? t("Change {{name}}", { name: group.name }) : t("New group"),
    body: [field(t("Name"), { name: "name", value: group?.name ?? "", maxlength: MOST_CHARACTERS, required: true, autocomplete: "off" }),
      h("fieldset", { class: "members" }, h("legend", null, t("Who is in it")), h("div", { class: "ticks" }, people.map(tick))),
      h("small", null, t("They see what is shared with the group as long as they are in it. Its name is for you alone."))],
    submit: t("Save"),
  });
  if (!answer) return null;
  const json = { name: String(answer.get("name") ?? "").trim(), members: answer.getAll("member").map(String) };
  /** @type {Group | null} */
  let made = null;
  await orSay(async () => {
    made = await requestJson(group ? `/api/groups/${encodeURIComponent(group.id)}` : "/api/groups", { method: group ? "PUT" : "POST", json });
  });
  return made;
}

/** @param {Group} group @returns {Promise<boolean>} whether it is gone */
export async function deleteGroup({ id, name }) {
  if (!(await confirmDelete(name, t("Those in it see what was shared with it no more.")))) return false;
  return orSay(() => request(`/api/groups/${encodeURIComponent(id)}`, { method: "DELETE" }));
}

// Sharing a map: with people of this server, with groups of them, and with everyone who has its link.

import { request, requestJson } from "../shared/api.js";
import { h, icon } from "../shared/dom.js";
import { byName } from "../shared/places.js";
import { counted, t } from "../shared/words.js";
import { askPerson, confirmDelete, field, orSay, showPerson } from "./dialogs.js";
import { smallButton } from "./lists.js";
import { addressField, codeOf } from "./session.js";

/** @typedef {import("./store.js").Map_} Map_ */
/** @typedef {"" | "read" | "edit"} May */
/** @typedef {{people: {user: string, name: string, may: May}[], groups: {group: string, name: string, may: May}[], link: {url: string, may: May} | null}} Shares */

/** @type {[May, string][]} */
const CHOICES = [["", t("No access")], ["read", t("Can view")], ["edit", t("Can edit")]];
const MANY_PEOPLE = 8;

/** Whose it is, where it is somebody else's. @param {{owner: string, right: string}} map */
export function ownerBadge({ owner, right }) {
  return right === "own" ? null : h("span", { class: "badge" }, t("Shared by {{owner}}", { owner }));
}

/** @param {{right: string, shared_with: number, has_link: boolean}} map @returns {string} */
export function sharedWords({ right, shared_with: count, has_link: hasLink }) {
  if (right === "read") return t("you can view it");
  if (right === "edit") return t("you can edit it");
  const whom = [count > 0 && counted(count, "{{count}} person", "{{count}} people"), hasLink && t("everyone with the link")].filter(Boolean);
  return whom.length > 0 ? t("shared with {{whom}}", { whom: whom.join(` ${t("and")} `) }) : "";
}

/** With whom a map is shared, to be looked at and changed. @param {{id: string, name: string}} map */
export async function shareMap({ id, name }) {
  const path = `/api/maps/${encodeURIComponent(id)}`;
  await orSay(async () => {
    const [people, groups, shares] = await Promise.all([requestJson("/api/people"), loadGroups(), requestJson(`${path}/shares`)]);
    const status = h("p", { class: "soft saved", role: "status" });
    /** Sends a change; whether it went well. @param {() => Promise<unknown>} deed */
    const save = async (deed) => {
      status.textContent = t("Saving…");
      try {
        await deed();
        status.textContent = t("Saved");
        return true;
      } catch (problem) { // a line at the foot of the page would lie under the dialog
        status.textContent = problem instanceof Error ? problem.message : String(problem);
        return false;
      }
    };
    await showPerson(t("Share {{name}}", { name }), [peoplePart(path, people, shares, save), people.length > 0 && groupPart(path, people, groups, shares, save), linkPart(path, shares, save), status]);
  });
}

/** @param {string} name @param {May} may @param {string} none @param {(may: May) => Promise<boolean>} changed */
function mayField(name, may, none, changed) {
  let last = may;
  const select = h("select", { "aria-label": name }, CHOICES.map(([value, words]) =>
    h("option", { value, selected: value === may }, value === "" ? none : words)));
  select.addEventListener("change", async () => {
    const wanted = /** @type {May} */ (select.value);
    if (await changed(wanted)) last = wanted;
    else select.value = last;
  });
  return select;
}

/**
 * @param {string} path @param {{id: string, name: string}[]} people @param {Shares} shares
 * @param {(deed: () => Promise<unknown>) => Promise<boolean>} save
 */
function peoplePart(path, people, shares, save) {
  const has = new Map(shares.people.map(({ user, may }) => [user, may]));
  const rows = people.map(({ id, name }) => {
    const address = `${path}/shares/${encodeURIComponent(id)}`;
    const set = (/** @type {May} */ may) => save(() => (may === ""
      ? request(address, { method: "DELETE" }) : requestJson(address, { method: "PUT", json: { may } })));
    return h("li", { "data-name": name.toLowerCase() }, h("span", null, name), mayField(t("What {{name}} may do", { name }), has.get(id) ?? "", t("No access"), set));
  });
  const search = h("input", { type: "search", placeholder: t("Search people"), "aria-label": t("Search people"), autocomplete: "off" });
  search.addEventListener("input", () => {
    for (const row of rows) row.hidden = !row.dataset.name.includes(search.value.trim().toLowerCase());
  });
  return h("section", { class: "stack tight", "aria-labelledby": "share-people" },
    h("h3", { id: "share-people" }, t("People")),
    people.length === 0 && h("p", { class: "soft" }, t("Nobody else has been let in to this server yet. Its owner invites them under People; a link works without that.")),
    people.length > MANY_PEOPLE && search,
    rows.length > 0 && h("ul", { class: "people" }, rows));
}

/**
 * @param {string} path @param {Person[]} people @param {Group[]} groups
 * @param {Shares} shares @param {(deed: () => Promise<unknown>) => Promise<boolean>} save
 */
function groupPart(path, people, groups, shares, save) {
  const has = new Map(shares.groups.map(({ group, may }) => [group, may]));
  const list = h("ul", { class: "people groups" });
  const known = new Map(groups.map((group) => [group.id, group]));

  /** @param {Group} group */
  function row(group) {
    const { id, name } = group;
    const address = `${path}/groups/${encodeURIComponent(id)}`;
    const set = async (/** @type {May} */ may) => {
      const well = await save(() => (may === "" ? request(address, { method: "DELETE" }) : requestJson(address, { method: "PUT", json: { may } })));
      if (well) has.set(id, may);
      return well;
    };
    return h("li", null, h("span", null, name, h("small", null, ` ${sizeOf(group)}`)),
      smallButton("edit", t("Change {{name}}", { name }), () => change(group)), smallButton("trash", t("Delete {{name}}", { name }), () => remove(group), "danger"),
      mayField(t("What {{name}} may do", { name }), has.get(id) ?? "", t("No access"), set));
  }

  function show() {
    list.replaceChildren(...[...known.values()].sort((one, other) => byName(one.name, other.name)).map(row));
    list.hidden = known.size === 0;
  }

  /** @param {Group | null} group */
  async function change(group) {
    const made = await askGroup(people, group);
    if (!made) return;
    known.set(made.id, made);
    show();
  }

  /** @param {Group} group */
  async function remove(group) {
    if (!(await deleteGroup(group))) return;
    known.delete(group.id);
    has.delete(group.id);
    show();
  }

  show();
  return h("section", { class: "stack tight", "aria-labelledby": "share-groups" },
    h("h3", { id: "share-groups" }, t("Groups")), list,
    h("button", { type: "button", class: "button small", click: () => change(null) }, icon("plus"), t("New group")));
}

/**
 * @param {string} path @param {Shares} shares @param {(deed: () => Promise<unknown>) => Promise<boolean>} save
 */
function linkPart(path, shares, save) {
  const place = h("div", { class: "stack tight" });
  const show = (/** @type {Shares["link"]} */ link) => place.replaceChildren(...(link === null ? [] : [
    ...addressField(link.url), h("details", null, h("summary", null, t("As a QR code")), codeOf(link.url))]));
  const set = async (/** @type {May} */ may) => {
    if (may === "" && !(await confirmWithdrawal())) return false;
    return save(async () => {
      if (may === "") await request(`${path}/link`, { method: "DELETE" });
      show(may === "" ? null : (await requestJson(`${path}/link`, { method: "PUT", json: { may } })).link);
    });
  };
  show(shares.link);
  return h("section", { class: "stack tight", "aria-labelledby": "share-link" },
    h("h3", { id: "share-link" }, t("Everyone who has the link")),
    h("ul", { class: "people" }, h("li", null, h("span", null, t("Without an account")), mayField(t("What everyone may do who has the link"), shares.link?.may ?? "", t("No link"), set))),
    place);
}

/** @returns {Promise<boolean>} */
async function confirmWithdrawal() {
  const body = h("p", null, t("Whoever has it can open the map no more. A link made later is another one. Phones keep the map if they have it."));
  return (await askPerson({ title: t("Withdraw the link?"), body, submit: t("Withdraw it"), danger: true, cancel: t("Keep it") })) !== null;
}

/** A map that somebody else shared leaves one's own list. @param {Map_} map @returns {Promise<boolean>} whether it is gone */
export async function leaveMap({ id, name, owner }) {
  const body = h("p", null, t("{{owner}} keeps the map, and can share it with you again. Where it is shared with a group that you are in, you leave the group.", { owner }));
  if ((await askPerson({ title: t("Take {{name}} off your list?", { name }), body, submit: t("Take it off"), danger: true, cancel: t("Keep it") })) === null) return false;
  return orSay(async () => {
    const me = await requestJson("/api/me");
    await request(`/api/maps/${encodeURIComponent(id)}/shares/${encodeURIComponent(me.id)}`, { method: "DELETE" });
  });
}

// Groups of people with whom maps are shared at once: a new one, who is in it, and its end.

/** @typedef {{id: string, name: string}} Person */
/** @typedef {{id: string, name: string, members: Person[]}} Group */

const MOST_CHARACTERS = "120";

/** @returns {Promise<Group[]>} */
const loadGroups = () => requestJson("/api/groups");

/** @param {Group} group */
function sizeOf({ members }) {
  return counted(members.length, "{{count}} person", "{{count}} people");
}

/** A group made or changed, once a person said how; null where nothing came of it.
 * @param {Person[]} people of this server @param {Group | null} group a new one where it is null
 * @returns {Promise<Group | null>} */
async function askGroup(people, group) {
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
async function deleteGroup({ id, name }) {
  if (!(await confirmDelete(name, t("Those in it see what was shared with it no more.")))) return false;
  return orSay(() => request(`/api/groups/${encodeURIComponent(id)}`, { method: "DELETE" }));
}

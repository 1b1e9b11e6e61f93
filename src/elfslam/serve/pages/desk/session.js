// Who is here: the token of the address becomes a cookie, and leaves the address.

import { forgetHere } from "../keeping/store.js";
import { Problem, linkIn, openSession, pairWith, request, requestJson } from "../shared/api.js";
import { h, icon, one, svg } from "../shared/dom.js";
import { formatAgo } from "../shared/format.js";
import { t, woven } from "../shared/words.js";
import { qrcode } from "../vendor/qrcode-generator/qrcode.mjs";
import { askPerson, confirmDelete, field, orSay, say, showPerson } from "./dialogs.js";
import { cell, headOf, iconButton, renameMe, rowHead, tableOf } from "./lists.js";

/** @typedef {{id: string, name: string, is_owner: boolean, used_bytes: number, limits: any}} Me */

/**
 * Whoever the page belongs to; null without a session. Throws Problem for anything else.
 * @returns {Promise<Me | null>}
 */
export async function whoIsHere() {
  try {
    await openSession(location, history);
    return await requestJson("/api/me");
  } catch (problem) {
    if (problem instanceof Problem && problem.status === 401) return null;
    throw problem;
  }
}

/** Forget the maps that this browser keeps, and its session: the page leaves as soon as that is gone. */
async function signOut() {
  await forgetHere();
  await request("/api/session", { method: "DELETE" });
}

// Who is here: their name and what they can do in the bar; and what nobody knows sees.

/** @param {Me} me */
export function showWho(me) {
  const name = h("button", { type: "button", class: "button small quiet name", title: t("Change your name"), click: async () => {
    if (await renameMe(me.name)) location.reload();
  } }, me.name);
  one("#who").replaceChildren(h("a", { class: "button icon", href: "./", "aria-label": t("Walk with this device"), title: t("Walk with this device") }, icon("phone")),
    name,
    h("button", { type: "button", class: "button small quiet", click: () => void pairAnother() }, t("Pair a device")),
    h("button", { type: "button", class: "button small quiet", click: async () => {
    if (await orSay(signOut)) location.reload();
  } }, t("Sign out")));
  one("#nav-users").hidden = !me.is_owner;
  one("nav").hidden = false;
}

/** Nobody is known: say how to come in. */
export function showDoor() {
  one("nav").hidden = true;
  one("#who").replaceChildren();
  const input = h("input", { name: "code", required: true, autocomplete: "off", spellcheck: "false", placeholder: "https://…/#token=…" });
  const form = h("form", { class: "card" },
    h("h1", null, t("This browser is not paired")),
    h("p", null, woven("Open the address that {{command}} printed in its terminal, with all that follows the {{sign}}, or one that “Pair a device” shows on a desk that is paired.",
      { command: h("code", null, "elfslam serve"), sign: h("code", null, "#") })),
    h("label", { class: "field" }, h("span", null, t("Or paste it here")), input),
    h("div", { class: "row" }, h("button", { type: "submit", class: "button primary" }, t("Pair"))));
  form.addEventListener("submit", async (/** @type {Event} */ event) => {
    event.preventDefault();
    if (await orSay(() => pairWith(input.value))) location.reload();
    else say(t("This code opens nothing here; copy it whole."), "problem");
  });
  document.body.dataset.page = "door";
  one("main").replaceChildren(h("div", { class: "door" }, form));
}

/** In the place of a page that cannot be shown. @param {string} title @param {string} words @param {any} [next] a link
 * or a button */
export function blankPage(title, words, next) {
  return h("div", { class: "empty" }, h("h1", { tabindex: "-1" }, title), h("p", null, words), next);
}

// QR codes of addresses that pair a device.

const QUIET_MODULES = 4;

/** Shows a code that pairs one more device with whoever is here. */
async function pairAnother() {
  await orSay(async () => {
    const { url, expires_s: expires } = await requestJson("/api/pairing", { method: "POST" });
    const what = t("Scan it with your other device, or open the address there, within {{minutes}} minutes. It works once.", { minutes: Math.round(expires / 60) });
    await showPerson(t("Pair another device"), invitation(url, what));
  });
}

/** What a dialog shows of an address that pairs. @param {string} url @param {string} what to do with it */
export function invitation(url, what) {
  return [h("p", null, what), codeOf(url), ...addressField(url)];
}

/** An address or another text, and what copies it. @param {string} text @param {string} [label] */
export function addressField(text, label = t("Address")) {
  const address = h("input", { readonly: true, value: text, "aria-label": label, name: "address" });
  const copy = h("button", { type: "button", class: "button" }, icon("copy"), t("Copy it"));
  copy.addEventListener("click", async () => {
    address.select();
    const well = await navigator.clipboard?.writeText(text).then(() => true, () => false);
    say(well ? t("It is in the clipboard.") : t("It is selected; copy it with the keyboard."));
  });
  return [address, h("div", { class: "row" }, copy)];
}

/** @param {string} text @returns {SVGElement} a QR code, dark on white in any theme */
export function codeOf(text) {
  const code = qrcode(0, "M");
  code.addData(text);
  code.make();
  const count = code.getModuleCount();
  let path = "";
  for (let row = 0; row < count; row += 1) {
    for (let column = 0; column < count; column += 1) {
      if (code.isDark(row, column)) path += `M${column + QUIET_MODULES} ${row + QUIET_MODULES}h1v1h-1z`;
    }
  }
  const side = count + 2 * QUIET_MODULES;
  return svg("svg", { viewBox: `0 0 ${side} ${side}`, class: "code", role: "img", "aria-label": t("QR code of the address"), "shape-rendering": "crispEdges" },
    svg("rect", { width: side, height: side, fill: "#fff" }), svg("path", { d: path, fill: "#000" }));
}

// Which page an address means. Pure.

/** @typedef {"recordings" | "jobs" | "maps" | "users" | "map" | "recording" | "shared" | "missing"} PageName */

const LISTS = ["recordings", "jobs", "maps", "users"];

/** @param {string} fragment such as #/maps/ID, or #link=… @returns {{name: PageName, id: string}} */
export function pageOf(fragment) {
  const link = linkIn(fragment);
  if (link !== null) return { name: "shared", id: link };
  const [name, id, ...more] = fragment.replace(/^#\/?/, "").split("/");
  if (name === "" && !id) return { name: "recordings", id: "" };
  if (name === "maps" && id && more.length === 0) return { name: "map", id: decoded(id) };
  if (name === "recordings" && id && more.length === 0) return { name: "recording", id: decoded(id) };
  if (LISTS.includes(name) && !id) return { name: /** @type {PageName} */ (name), id: "" };
  return { name: "missing", id: "" };
}

/** @param {string} text */
function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

// The people with a token: the owner lets them in and out.

/** @typedef {{id: string, name: string, is_owner: boolean, created_utc: string}} User */
/** @typedef {import("./main.js").Desk} Desk */

const INVITED = t("Scan it with their phone, or send them the address. It is shown this once and kept nowhere.");
const COLUMNS = [t("Name"), t("Since"), t("Actions")];

/** @param {Desk} desk */
export function usersView({ me, users, nowMs }) {
  const invite = h("button", { type: "button", class: "button primary", "data-action": "invite" }, icon("plus"), t("Invite somebody"));
  return h("div", { class: "page" },
    headOf(t("People"), t("Everyone sees their own recordings and maps, and the maps that others share with them."), me?.is_owner && invite),
    tableOf(t("People"), COLUMNS, users.map((user) => rowOf(user, nowMs()))));
}

/** @param {User} user @param {number} nowMs */
function rowOf({ id, name, is_owner, created_utc }, nowMs) {
  return h("tr", { "data-key": id, role: "row" },
    rowHead(h("strong", null, name), is_owner && h("span", { class: "badge" }, t("Owner"))),
    cell(t("Since"), formatAgo(created_utc, nowMs)),
    h("td", { class: "actions", role: "cell" }, !is_owner && iconButton("trash", "delete", id, t("Delete {{name}} and all that is theirs", { name }), "danger")));
}

/** @param {Desk} desk */
export function userActions(desk) {
  return {
    async invite() {
      const body = field(t("Name"), { name: "name", required: true, maxlength: "60", autocomplete: "off" });
      const answer = await askPerson({ title: t("Invite somebody"), body, submit: t("Make a code") });
      if (!answer) return;
      await orSay(async () => {
        const made = await requestJson("/api/users", { method: "POST", json: { name: String(answer.get("name")).trim() } });
        await desk.now();
        await showPerson(t("A code for {{name}}", { name: made.name }), invitation(made.url, INVITED));
      });
    },
    async delete(/** @type {string} */ id) {
      const user = desk.users.find((each) => each.id === id);
      if (!user) return;
      if (!(await confirmDelete(user.name, t("Their recordings, jobs and maps are deleted with them, also for those whom they shared them with, and their code opens nothing any more.")))) return;
      await orSay(() => request(`/api/users/${encodeURIComponent(id)}`, { method: "DELETE" }));
      await desk.now();
    },
  };
}

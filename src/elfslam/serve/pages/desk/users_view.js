// The people with a token: the owner lets them in and out.

import { request, requestJson } from "../shared/api.js";
import { askPerson, confirmDelete, field, orSay, showPerson } from "./dialogs.js";
import { invitation } from "./session.js";
import { h, icon } from "../shared/dom.js";
import { formatAgo } from "../shared/format.js";
import { cell, headOf, iconButton, rowHead, tableOf } from "./lists.js";
import { t } from "../shared/words.js";

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

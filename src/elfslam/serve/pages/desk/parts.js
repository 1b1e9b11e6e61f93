// What the lists of the desk are made of.

import { h, icon } from "../shared/dom.js";
import { t } from "../shared/words.js";

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
 * @param {any} words */
export function emptyPage(known, picture, title, words) {
  if (!known.loaded) return h("div", { class: "empty", "aria-busy": "true" }, h("p", { class: "soft" }, t("Asking the server…")));
  return h("div", { class: "empty" }, icon(picture), h("h2", null, title), h("p", { class: "soft" }, words));
}

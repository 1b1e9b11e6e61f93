// Dialogs: one question at a time, answered by keyboard or mouse; the focus goes back after.

import { h } from "../shared/dom.js";
import { t } from "../shared/words.js";

/** So many names stand in a question; the others are counted. */
const MOST_NAMED = 8;

let count = 0;

/**
 * Show a form in a dialog; the answer is its data, or null when it was left.
 * @param {{title: string, body: any, submit: string, danger?: boolean, cancel?: string}} question
 * @returns {Promise<FormData | null>}
 */
export function askPerson({ title, body, submit, danger = false, cancel = t("Cancel") }) {
  count += 1;
  const id = `dialog-${count}`;
  const form = h("form", { method: "dialog" },
    h("h2", { id }, title),
    h("div", { class: "dialog-body" }, body),
    h("div", { class: "dialog-buttons" },
      h("button", { type: "button", class: "button", "data-leave": true }, cancel),
      h("button", { type: "submit", class: danger ? "button danger" : "button primary", value: "yes" }, submit)));
  const dialog = h("dialog", { "aria-labelledby": id }, form);
  return new Promise((resolve) => {
    form.querySelector("[data-leave]").addEventListener("click", () => dialog.close(""));
    dialog.addEventListener("close", () => {
      resolve(dialog.returnValue === "yes" ? new FormData(form) : null);
      dialog.remove();
    });
    document.body.append(dialog);
    dialog.showModal();
    if (danger) form.querySelector("[data-leave]").focus();
  });
}

/**
 * Show something until it is closed.
 * @param {string} title @param {any} body @returns {Promise<void>}
 */
export function showPerson(title, body) {
  count += 1;
  const id = `dialog-${count}`;
  const close = h("button", { type: "submit", class: "button primary" }, t("Close"));
  const dialog = h("dialog", { "aria-labelledby": id, class: "wide" },
    h("form", { method: "dialog" }, h("h2", { id }, title)),
    h("div", { class: "dialog-body" }, body),
    h("form", { method: "dialog", class: "dialog-buttons" }, close));
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve();
    });
    document.body.append(dialog);
    dialog.showModal();
    close.focus();
  });
}

/** @param {string} what @param {string} consequence @param {string[]} [names] of all that goes @returns {Promise<boolean>} */
export async function confirmDelete(what, consequence, names = []) {
  const more = names.length - MOST_NAMED;
  const body = [names.length > 0 && h("ul", { class: "plain" }, names.slice(0, MOST_NAMED).map((name) => h("li", null, name)), more > 0 && h("li", null, t("and {{count}} more", { count: more }))),
    h("p", null, consequence)];
  return (await askPerson({ title: t("Delete {{what}}?", { what }), body, submit: t("Delete for good"), danger: true, cancel: names.length > 1 ? t("Keep them") : t("Keep it") })) !== null;
}

/** One line at the foot of the page, read out by screen readers.
 * @param {string} text @param {"note" | "problem"} [kind] */
export function say(text, kind = "note") {
  const place = document.getElementById(kind === "problem" ? "problems" : "notes");
  if (!place) return;
  const line = h("p", { class: `toast ${kind}` }, h("span", null, text),
    h("button", { type: "button", class: "icon", "aria-label": t("Dismiss") }, "×"));
  line.querySelector("button").addEventListener("click", () => line.remove());
  place.replaceChildren(line);
  if (kind === "note") setTimeout(() => line.remove(), 6000);
}

/** Do something and say what went wrong, if it did.
 * @param {() => Promise<unknown>} deed @returns {Promise<boolean>} whether it went well */
export async function orSay(deed) {
  try {
    await deed();
    return true;
  } catch (problem) {
    say(problem instanceof Error ? problem.message : String(problem), "problem");
    return false;
  }
}

// Who is here: their name and what they can do in the bar; and what nobody knows sees.

import { orSay, say } from "./dialogs.js";
import { pairAnother } from "./codes.js";
import { renameMe } from "./renaming.js";
import { signOut } from "./session.js";
import { pairWith } from "../shared/api.js";
import { h, icon, one } from "../shared/dom.js";
import { t, woven } from "../shared/words.js";

/** @param {import("./session.js").Me} me */
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

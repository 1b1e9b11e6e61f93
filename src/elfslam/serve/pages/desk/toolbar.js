// Above a list: what is searched for, what it is sorted by, and what is done with the chosen ones.

import { h, icon } from "../shared/dom.js";
import { SORTS } from "./finding.js";
import { counted, inSentence, t } from "../shared/words.js";

/** @typedef {import("./finding.js").Order} Order */
/** @typedef {import("./finding.js").Sort} Sort */

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

/** The control that says which language the page speaks. */

import { h } from "./dom.js";
import { language, t } from "./words.js";

/** Each language by its own name. @param {string} tag */
function nameOf(tag) {
  const name = new Intl.DisplayNames(tag, { type: "language" }).of(tag) ?? tag;
  return name[0].toUpperCase() + name.slice(1);
}

/** @returns {HTMLElement} a label with its list; whoever chooses gets the page anew */
export function languageChoice() {
  const { languages, choose } = /** @type {ElfslamLanguage} */ (window.elfslamLanguage);
  const options = languages.map((tag) => h("option", { value: tag, lang: tag, selected: tag === language }, nameOf(tag)));
  const list = h("select", { id: "language", autocomplete: "off", change: () => choose(list.value) }, options);
  return h("label", { class: "language" }, h("span", null, t("Language")), list);
}

/**
 * Words in the reader's language. English stands in the source, where it is read, and is its own key; another
 * language has a catalogue (`words/de.json`), which is there before any module that imports this one runs. In
 * workers and in node there is English alone.
 */

import { createInstance } from "../vendor/i18next/i18next.js";
import { h } from "./dom.js";

// The words that stand in a page's HTML, in the reader's language: once, before the page is shown.

const ATTRIBUTES = ["aria-label", "title", "placeholder", "alt"];
/** What is inside is no language: names, addresses, figures. */
const NOT_WORDS = "script, style, noscript, [translate=no]";

/** @param {string} text as it stands in the HTML @returns {string} without what HTML makes nothing of */
function bare(text) {
  return text.replace(/\s+/g, " ").trim();
}

/** @param {Element} root @param {(text: string) => string} translated */
function translateElements(root, translated) {
  const walker = document.createTreeWalker(root, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node !== null; node = walker.nextNode()) {
    const text = node.nodeValue ?? "";
    if (bare(text) === "" || node.parentElement?.closest(NOT_WORDS)) continue;
    const [before, after] = [/^\s*/, /\s*$/].map((space) => space.exec(text)?.[0] ?? "");
    node.nodeValue = before + translated(bare(text)) + after;
  }
  for (const name of ATTRIBUTES) {
    for (const element of root.querySelectorAll(`[${name}]:not([translate=no])`)) {
      element.setAttribute(name, translated(bare(element.getAttribute(name) ?? "")));
    }
  }
}

/** @typedef {Record<string, string | number>} Values */

const given = globalThis.elfslamLanguage;
const fetched = given ? await given.catalogue : {};
/** @type {Record<string, string>} */
const catalogue = fetched ?? {};

export const language = given && fetched ? given.language : "en";
/** Of numbers and dates: the reader's own kind of the language, such as de-CH. */
export const locale = given && fetched ? given.locale : "en";

const library = createInstance();
library.init({
  lng: language,
  fallbackLng: false,
  resources: { [language]: { translation: catalogue } },
  keySeparator: false,
  nsSeparator: false,
  initAsync: false,
  interpolation: { escapeValue: false }, // nothing of it is parsed as HTML
});

/**
 * @param {string} text English, with the names of values as in `{{name}}` @param {Values} [values]
 * @returns {string}
 */
export function t(text, values = {}) {
  return library.t(text, values);
}

/**
 * What is counted, in as many forms as the language has.
 * @param {number} count `{{count}}` of the texts, or `{{count, number}}` where it may be large
 * @param {string} one English for one @param {string} many English for any other count, and the key
 * @param {Values} [values] besides @returns {string}
 */
export function counted(count, one, many, values = {}) {
  return library.t(many, { ...values, count, defaultValue_one: one, defaultValue_other: many });
}

/**
 * A text with elements in it.
 * @param {string} text English @param {Record<string, Node>} nodes by their names in the text
 * @returns {(Node | string)[]}
 */
export function woven(text, nodes) {
  const marked = Object.fromEntries(Object.keys(nodes).map((name) => [name, `\u0000${name}\u0000`]));
  return t(text, marked).split("\u0000").map((piece, at) => (at % 2 === 1 ? nodes[piece] : piece));
}

/** The name of a thing inside a sentence: English begins it small, other languages write it as it is.
 * @param {string} name @returns {string} */
export function inSentence(name) {
  return language === "en" ? name.charAt(0).toLowerCase() + name.slice(1) : name;
}

/** Refusals of the server that hold values, `{{1}}` and so on, with their keys. @type {[RegExp, string][]} */
const refusals = Object.keys(catalogue)
  .filter((key) => /\{\{\d\}\}/.test(key))
  .map((key) => [new RegExp(`^${key.replace(/[$()*+.?[\\\]^|]/g, "\\$&").replace(/\{\{\d\}\}/g, "(.+?)")}$`), key]);

/**
 * A text that comes from elsewhere, a worker or the server: in the reader's language where the catalogue has it, else
 * as it came.
 * @param {string} text @returns {string}
 */
export function translated(text) {
  if (Object.hasOwn(catalogue, text)) return catalogue[text];
  for (const [pattern, key] of refusals) {
    const found = pattern.exec(text);
    if (found) return library.t(key, Object.fromEntries(found.slice(1).map((value, at) => [at + 1, kindOf(value)])));
  }
  return text;
}

/** What the server calls a thing, as "map", or a reason within a refusal; names that people gave stay.
 * @param {string} value */
function kindOf(value) {
  return /^[a-z0-9]/.test(value) ? translated(value) : value;
}

if (globalThis.document) {
  const root = document.documentElement;
  root.lang = language;
  if (language !== "en") translateElements(root, translated);
  delete root.dataset.words;
}

// The control that says which language the page speaks.

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

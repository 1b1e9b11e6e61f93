// The words of the pages in another language than the source, and which language that is.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { runInNewContext } from "node:vm";

const PAGES = new URL("../../../src/elfslam/serve/pages/", import.meta.url);
const WORDS = {
  "{{name}} has arrived.": "{{name}} ist angekommen.",
  "Map": "Karte",
  "map": "Karte",
  "there is no such {{1}} here; it may (soon) be back": "hier ist keine {{1}}; vielleicht kommt sie wieder",
  "{{1}}: {{2}} of {{3}} bytes have come": "{{1}}: {{2}} von {{3}} Byte sind da",
  "no walk could be added; {{1}}: {{2}}": "kein Gang ließ sich anfügen; {{1}}: {{2}}",
  "with {{1}}: {{2}}": "mit {{1}}: {{2}}",
  "only {{1}} m2 in common": "nur {{1}} m² gemeinsam",
  "Map_verb": "Kartieren",
  "{{count, number}} footsteps_one": "{{count, number}} Schritt",
  "{{count, number}} footsteps_other": "{{count, number}} Schritte",
  "Open {{page}} on a phone and walk, or drop recordings here.": "Öffne {{page}} und geh.",
};
globalThis.elfslamLanguage = { language: "de", locale: "de-DE", languages: ["en", "de"], catalogue: Promise.resolve(WORDS), choose() {} };
const { counted, inSentence, language, t, translated, woven } = await import(`${PAGES}shared/words.js`);
const { formatBytes, formatMetres, formatMoment, formatNumber } = await import(`${PAGES}shared/format.js`);
const { formatAgo, formatCount } = await import(`${PAGES}shared/format.js`);
const { usualName } = await import(`${PAGES}phone/view.js`);

test("a text is said in the language, what the catalogue lacks in English", () => {
  assert.equal(language, "de");
  assert.equal(t("Map"), "Karte");
  assert.equal(t("Map", { context: "verb" }), "Kartieren");
  assert.equal(t("{{count}} left over: {{what}}", { count: 3, what: "three" }), "3 left over: three");
});

test("what people call things is never read as a text with values", () => {
  const name = "{{count}} $t(Map) <b>&amp;</b>";
  assert.equal(t("{{name}} has arrived.", { name }), `${name} ist angekommen.`);
});

test("what is counted has the forms of the language", () => {
  const said = (/** @type {number} */ count) => counted(count, "{{count, number}} footstep", "{{count, number}} footsteps");
  assert.deepEqual([0, 1, 2, 14400].map(said), ["0 Schritte", "1 Schritt", "2 Schritte", "14.400 Schritte"]);
  const lacking = (/** @type {number} */ count) => counted(count, "{{count}} box", "{{count}} boxes");
  assert.deepEqual([1, 2].map(lacking), ["1 box", "2 boxes"]);
});

test("elements are woven in where the language wants them", () => {
  const page = /** @type {any} */ ({ is: "a link" });
  assert.deepEqual(woven("Open {{page}} on a phone and walk, or drop recordings here.", { page }), ["Öffne ", page, " und geh."]);
});

test("a text from elsewhere is translated where the catalogue has exactly it", () => {
  assert.equal(translated("Map"), "Karte");
  assert.equal(translated("map: 3 of 7"), "map: 3 of 7");
  assert.equal(translated("toString"), "toString");
  assert.equal(inSentence("Aufnahmen"), "Aufnahmen");
});

test("a refusal with values is translated around them, and names stay", () => {
  assert.equal(translated("there is no such map here; it may (soon) be back"), "hier ist keine Karte; vielleicht kommt sie wieder");
  assert.equal(translated("Map: 3 of 7 bytes have come"), "Map: 3 von 7 Byte sind da");
  assert.equal(translated("no walk could be added; Kitchen: with Map: only 3 m2 in common"), "kein Gang ließ sich anfügen; Kitchen: mit Map: nur 3 m² gemeinsam");
  assert.equal(translated("$t(Map) {{1}}: 3 of 7 bytes have come"), "$t(Map) {{1}}: 3 von 7 Byte sind da");
  assert.equal(translated("there is no such map here; it may be back"), "there is no such map here; it may be back");
});

test("numbers and dates are written as the reader writes them", () => {
  assert.equal(formatNumber(1234.5, 1), "1234,5");
  assert.equal(formatMetres(12.34), "12,3 m");
  assert.equal(formatBytes(1_400_000), "1,4\u00a0MB");
  assert.equal(formatMoment(61.5), "1:01,5");
  assert.equal(formatCount(1234567), "1.234.567");
  assert.equal(formatAgo("2026-10-01T00:00:00Z", Date.parse("2026-11-21T18:00:00Z")), "01.10.2026");
  assert.equal(usualName(new Date(2026, 10, 21, 9)), "Morning walk, 21. Nov.");
});

/** What a page is told where a browser prefers these languages and remembers that one. @param {string[]} languages
 * @param {string | null} remembered @param {boolean} [isClosed] whether the browser lets pages remember nothing */
function told(languages, remembered, isClosed = false) {
  const asked = [];
  const kept = new Map(remembered === null ? [] : [["elfslam-language", remembered]]);
  const page = {
    document: { documentElement: { lang: "en", dataset: {} }, currentScript: { src: "https://here/shared/language.js" } },
    navigator: { languages },
    localStorage: {
      getItem: (/** @type {string} */ name) => (isClosed ? refuse() : kept.get(name) ?? null),
      setItem: (/** @type {string} */ name, /** @type {string} */ value) => (isClosed ? refuse() : kept.set(name, value)),
    },
    location: { reload: () => asked.push("again") },
    setTimeout: () => 0, URL,
    fetch: async (/** @type {URL} */ address) => {
      asked.push(String(address));
      return { ok: false };
    },
  };
  runInNewContext(readFileSync(new URL("shared/language.js", PAGES), "utf8"), { ...page, window: page });
  return { given: /** @type {any} */ (page).elfslamLanguage, root: page.document.documentElement, asked, kept };
}

function refuse() {
  throw new Error("SecurityError");
}

test("the language is the first that is preferred and that there is", () => {
  assert.equal(told(["de-CH", "en"], null).root.lang, "de");
  assert.equal(told(["fr-CH", "de-CH"], null).given.locale, "de-CH");
  assert.equal(told(["en-GB", "de"], null).root.lang, "en");
  assert.equal(told(["en-GB", "de"], null).given.locale, "en-GB");
  assert.equal(told(["fr", "it"], null).root.lang, "en");
  assert.equal(told([], null).root.lang, "en");
});

test("what was chosen here comes first, as long as there is such a language", () => {
  assert.equal(told(["de"], "en").root.lang, "en");
  assert.equal(told(["en-GB"], "de").given.locale, "de");
  assert.equal(told(["de"], "tlh").root.lang, "de");
  assert.equal(told(["de"], "en", true).root.lang, "de");
});

test("only another language asks for its words, and hides the page until then", async () => {
  const english = told(["en"], null);
  assert.deepEqual([english.asked, english.root.dataset], [[], {}]);
  const german = told(["de"], null);
  assert.deepEqual(german.asked, ["https://here/words/de.json"]);
  assert.equal(german.root.dataset.words, "coming");
  assert.equal(await german.given.catalogue, null, "what cannot be had is no catalogue");
});

test("whoever chooses gets the page anew, and keeps the choice", () => {
  const { given, kept, asked } = told(["en"], null);
  given.choose("de");
  assert.equal(kept.get("elfslam-language"), "de");
  assert.deepEqual(asked, ["again"]);
});

/** The words that stand in a page's HTML, in the reader's language: once, before the page is shown. */

const ATTRIBUTES = ["aria-label", "title", "placeholder", "alt"];
/** What is inside is no language: names, addresses, figures. */
const NOT_WORDS = "script, style, noscript, [translate=no]";

/** @param {string} text as it stands in the HTML @returns {string} without what HTML makes nothing of */
function bare(text) {
  return text.replace(/\s+/g, " ").trim();
}

/** @param {Element} root @param {(text: string) => string} translated */
export function translateElements(root, translated) {
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

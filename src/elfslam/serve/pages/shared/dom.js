// Elements, and tables that change in place: what did not change keeps focus, hover and clicks.

const SVG = "http://www.w3.org/2000/svg";

/**
 * An element. Attributes that are false, null or undefined are left out; true stands alone.
 * Nothing is ever parsed as HTML.
 * @param {string} tag
 * @param {Record<string, any> | null} [attributes]
 * @param {...any} children nodes, text, arrays of them; null and false are left out
 * @returns {any}
 */
export function h(tag, attributes = null, ...children) {
  return fill(document.createElement(tag), attributes, children);
}

/** @param {string} tag @param {Record<string, any> | null} [attributes] @param {...any} children
 * @returns {any} */
export function svg(tag, attributes = null, ...children) {
  return fill(document.createElementNS(SVG, tag), attributes, children);
}

/** @param {Element} element @param {Record<string, any> | null} attributes @param {any[]} children */
function fill(element, attributes, children) {
  for (const [name, value] of Object.entries(attributes ?? {})) {
    if (value === false || value === null || value === undefined) continue;
    if (name === "style") styled(element, value);
    else if (typeof value === "function") element.addEventListener(name.replace(/^on/, ""), value);
    else element.setAttribute(name, value === true ? "" : String(value));
  }
  element.append(...children.flat(Infinity).filter((c) => c !== null && c !== undefined && c !== false));
  return element;
}

/** Through the object model, for a page's policy may forbid style attributes.
 * @param {any} element @param {Record<string, string>} styles */
function styled(element, styles) {
  for (const [name, value] of Object.entries(styles)) element.style.setProperty(name, value);
}

/** The one element for a selector. @param {string} selector @param {ParentNode} [root]
 * @returns {any} */
export function one(selector, root = document) {
  const found = root.querySelector(selector);
  if (found === null) throw new Error(`no element ${selector}`);
  return found;
}

/**
 * Make `now` look like `wanted`, touching only what differs. Children are matched by `data-key`
 * where they have one, else by position. Listeners belong on an ancestor.
 * @param {Element} now @param {Element} wanted
 */
export function morph(now, wanted) {
  morphAttributes(now, wanted);
  morphChildren(now, wanted);
}

/** @param {Element} now @param {Element} wanted */
function morphAttributes(now, wanted) {
  for (const { name } of [...now.attributes]) {
    if (!wanted.hasAttribute(name)) now.removeAttribute(name);
  }
  for (const { name, value } of wanted.attributes) {
    if (name === "style") /** @type {any} */ (now).style.cssText = /** @type {any} */ (wanted).style.cssText;
    else if (now.getAttribute(name) !== value) now.setAttribute(name, value);
  }
}

/** @param {Element} now @param {Element} wanted */
function morphChildren(now, wanted) {
  const keyed = new Map([...now.children].filter(keyOf).map((child) => [keyOf(child), child]));
  let at = now.firstChild;
  for (const next of [...wanted.childNodes]) {
    const match = keyOf(next) ? keyed.get(keyOf(next)) : alike(at, next) ? at : null;
    if (match && match.nodeName === next.nodeName) {
      if (match !== at) now.insertBefore(match, at);
      else at = at.nextSibling;
      if (match instanceof Element) morph(match, /** @type {Element} */ (next));
      else if (match.nodeValue !== next.nodeValue) match.nodeValue = next.nodeValue;
    } else {
      now.insertBefore(next, at);
    }
  }
  while (at) {
    const gone = at;
    at = at.nextSibling;
    gone.remove();
  }
}

/** @param {Node | null} node @returns {string | undefined} */
function keyOf(node) {
  return node instanceof HTMLElement ? node.dataset.key : undefined;
}

/** @param {Node | null} now @param {Node} next */
function alike(now, next) {
  return now !== null && !keyOf(now) && now.nodeName === next.nodeName;
}

/**
 * Clicks on `[data-action]` inside `root`, wherever they come from.
 * @param {HTMLElement} root
 * @param {Record<string, (id: string, element: HTMLElement) => void>} actions
 */
export function onActions(root, actions) {
  root.addEventListener("click", (event) => {
    const element = /** @type {HTMLElement | null} */ (
      /** @type {Element} */ (event.target).closest("[data-action]")
    );
    if (!element || element.getAttribute("aria-disabled") === "true") return;
    actions[element.dataset.action ?? ""]?.(element.dataset.id ?? "", element);
  });
}

// Small pictures, drawn in the colour of the text. They say nothing to a screen reader.

/** Paths in a box of 24, drawn as lines. */
const PATHS = {
  download: "M12 4v11m0 0-4.5-4.5M12 15l4.5-4.5M5 19.5h14",
  upload: "M12 15V4m0 0L7.5 8.5M12 4l4.5 4.5M5 19.5h14",
  trash: "M4.5 7h15M9.5 7V4.5h5V7m-8 0 .8 12.5h9.4L17.5 7M10 10.5v5.5m4-5.5v5.5",
  map: "M9 5 4 7v12l5-2 6 2 5-2V5l-5 2-6-2Zm0 0v12m6-10v12",
  locate: "M12 21s-6.5-5.6-6.5-11a6.5 6.5 0 0 1 13 0C18.5 15.4 12 21 12 21Zm0-8.5a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5Z",
  report: "M6.5 3.5h7l4 4v13h-11v-17Zm7 0v4h4M9.5 12h5m-5 4h5",
  stop: "M7 7h10v10H7z",
  again: "M19 12a7 7 0 1 1-2.3-5.2M19 4v4h-4",
  plus: "M12 5v14M5 12h14",
  minus: "M5 12h14",
  fit: "M4.5 9V4.5H9m6 0h4.5V9m0 6v4.5H15m-6 0H4.5V15",
  back: "M14.5 5.5 8 12l6.5 6.5",
  phone: "M8 3.5h8a1 1 0 0 1 1 1v15a1 1 0 0 1-1 1H8a1 1 0 0 1-1-1v-15a1 1 0 0 1 1-1Zm3 14h2",
  follow: "M12 3v3m0 12v3M3 12h3m12 0h3M12 18a6 6 0 1 0 0-12 6 6 0 0 0 0 12Zm0-4.5a1.5 1.5 0 1 0 0-3 1.5 1.5 0 0 0 0 3Z",
  copy: "M9 9h10.5v10.5H9zM5 15H4.5V4.5H15V5",
  image: "M4.5 5.5h15v13h-15zM5 16l4.5-4.5L14 16l2.5-2.5 3 3M15.5 9h.01",
  search: "M10.5 17a6.5 6.5 0 1 0 0-13 6.5 6.5 0 0 0 0 13Zm4.8-1.7 4.2 4.2",
  edit: "M4.5 19.5v-4L15.5 4.5l4 4-11 11h-4Zm8.5-12.5 4 4",
  share: "M8.6 10.7 15.4 7m-6.8 6.3 6.8 3.7M6 14.5a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5Zm12-6a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5Zm0 12a2.5 2.5 0 1 0 0-5 2.5 2.5 0 0 0 0 5Z",
  leave: "M10 4.5H5v15h5M14 8l4 4-4 4m4-4H9",
  link: "M10 14.5 14.5 10M9 11l-2.6 2.6a3.2 3.2 0 0 0 4.5 4.5L13.5 15.5M15 13l2.6-2.6a3.2 3.2 0 0 0-4.5-4.5L10.5 8.5",
  layers: "m12 4 8 4.5-8 4.5-8-4.5L12 4Zm-8 8.5 8 4.5 8-4.5",
};

/** @param {keyof typeof PATHS} name @returns {SVGElement} */
export function icon(name) {
  return svg("svg", { viewBox: "0 0 24 24", class: "icon", "aria-hidden": "true", focusable: "false" },
    svg("path", { d: PATHS[name] }));
}

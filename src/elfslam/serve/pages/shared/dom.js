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

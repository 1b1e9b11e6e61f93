// Which rows of a list are shown, and in which order. Pure.

import { byName } from "../shared/places.js";
import { t } from "../shared/words.js";

/** @typedef {"newest" | "oldest" | "name" | "longest"} Sort */
/** @typedef {{find: string, by: Sort}} Order what somebody searches for, and what a list is sorted by */

/** @type {Record<Sort, string>} */
export const SORTS = { newest: t("Newest first"), oldest: t("Oldest first"), name: t("By name"), longest: t("Longest first") };

/** @returns {Order} */
export function firstOrder() {
  return { find: "", by: "newest" };
}

/** Letters without case and accents. @param {string} text */
function plain(text) {
  return text.normalize("NFD").replace(/\p{M}/gu, "").toLowerCase();
}

/** Those in which every word of a search stands. @template T @param {T[]} things @param {string} find
 * @param {(thing: T) => (string | null | undefined)[]} textsOf @returns {T[]} */
export function matching(things, find, textsOf) {
  const words = plain(find).split(/\s+/).filter(Boolean);
  if (words.length === 0) return things;
  return things.filter((thing) => {
    const text = plain(textsOf(thing).filter(Boolean).join(" "));
    return words.every((word) => text.includes(word));
  });
}

/** @template {{name: string, created_utc: string}} T @param {T[]} things @param {Sort} by
 * @param {(thing: T) => number | null | undefined} lengthOf @returns {T[]} */
export function sorted(things, by, lengthOf) {
  const newest = (/** @type {T} */ a, /** @type {T} */ b) => b.created_utc.localeCompare(a.created_utc);
  /** @type {Record<Sort, (a: T, b: T) => number>} */
  const orders = {
    newest,
    oldest: (a, b) => newest(b, a),
    name: (a, b) => byName(a.name, b.name) || newest(a, b),
    longest: (a, b) => (lengthOf(b) ?? -1) - (lengthOf(a) ?? -1) || newest(a, b),
  };
  return [...things].sort(orders[by]);
}

/** The chosen ones among those that are shown: what nobody sees is not acted on.
 * @template {{id: string}} T @param {T[]} shown @param {Set<string>} chosen @returns {T[]} */
export function chosenOf(shown, chosen) {
  return shown.filter(({ id }) => chosen.has(id));
}

/** What is there no more is not chosen any more. @param {Set<string>} chosen @param {{id: string}[]} there */
export function forgetGone(chosen, there) {
  const ids = new Set(there.map(({ id }) => id));
  for (const id of chosen) if (!ids.has(id)) chosen.delete(id);
}

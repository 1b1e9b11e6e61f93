/** Venues, their floors, and the maps that lie there. Pure. */

import { locale } from "./words.js";

/**
 * @typedef {{venue?: string | null, floor?: string | null, level?: number | null}} Placed
 */

/** @param {string} one @param {string} other @returns {number} as people sort names with numbers in them */
export function byName(one, other) {
  return one.localeCompare(other, locale, { numeric: true, sensitivity: "base" });
}

/** Where something lies, in a line; "" where nobody said. @param {Placed} placed */
export function placeOf({ venue, floor }) {
  return [venue, floor].filter(Boolean).join(" · ");
}

/**
 * Things by venue and floor: venues by name, floors from below, what lies nowhere last. Each group keeps the order
 * that its things had.
 * @template {Placed} T @param {T[]} things @returns {{venue: string | null, floor: string | null, things: T[]}[]}
 */
export function grouped(things) {
  /** @type {Map<string, {venue: string | null, floor: string | null, level: number | null, things: T[]}>} */
  const groups = new Map();
  for (const thing of things) {
    const { venue = null, floor = null, level = null } = thing;
    const key = JSON.stringify([venue, floor]);
    const group = groups.get(key) ?? { venue, floor, level, things: [] };
    group.things.push(thing);
    groups.set(key, group);
  }
  return [...groups.values()].sort(inOrder).map(({ venue, floor, things: inside }) => ({ venue, floor, things: inside }));
}

/** @param {Placed} one @param {Placed} other */
function inOrder(one, other) {
  return nullsLast(one.venue, other.venue, byName)
    || nullsLast(one.level, other.level, (a, b) => a - b)
    || nullsLast(one.floor, other.floor, byName);
}

/** @template T @param {T | null | undefined} one @param {T | null | undefined} other
 * @param {(one: T, other: T) => number} order */
function nullsLast(one, other, order) {
  if (one === null || one === undefined) return other === null || other === undefined ? 0 : 1;
  return other === null || other === undefined ? -1 : order(one, other);
}

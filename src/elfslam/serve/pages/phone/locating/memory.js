/** What was heard lately: a unit vector per echo, until a fix has been made of it. Pure. */

import { meanOf } from "../../stages/locate.js";

const SIZE = 128;

/**
 * @param {number} fewest echoes that make a mean
 * @returns {{
 *   add: (tS: number[], vectors: Float32Array) => void,
 *   count: (fromS: number, toS: number) => number,
 *   mean: (fromS: number, toS: number) => Float32Array | null,
 *   forget: (beforeS: number) => void,
 *   firstS: () => number | null,
 * }} times are those of direct arrivals; from the first to before the second
 */
export function makeMemory(fewest) {
  /** @type {{tS: number, vector: Float32Array}[]} */
  let rows = [];
  /** @param {number} fromS @param {number} toS */
  const between = (fromS, toS) => rows.filter(({ tS }) => tS >= fromS && tS < toS);
  return {
    add(times, vectors) {
      times.forEach((tS, k) => rows.push({ tS, vector: vectors.slice(k * SIZE, (k + 1) * SIZE) }));
    },
    count: (fromS, toS) => between(fromS, toS).length,
    mean(fromS, toS) {
      const found = between(fromS, toS);
      if (found.length < fewest) return null;
      const together = new Float32Array(found.length * SIZE);
      found.forEach(({ vector }, k) => together.set(vector, k * SIZE));
      return meanOf(together, 0, found.length);
    },
    forget(beforeS) {
      rows = rows.filter(({ tS }) => tS >= beforeS);
    },
    firstS: () => rows[0]?.tS ?? null,
  };
}

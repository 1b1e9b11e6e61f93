// Uncertainty as a soft band: stretches of a walk of about the same sigma. Pure.

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {{sigma_m: number, points: Point[]}} Stretch */

/** Sigmas this alike are drawn alike. */
export const STEP_OF_SIGMA = 1.15;

/**
 * A walk cut where its sigma changes; neighbours share a point, so that the band has no gaps.
 * @param {Point[]} xy_m @param {(number | null)[]} sigma_m @returns {Stretch[]}
 */
export function stretches(xy_m, sigma_m) {
  /** @type {Stretch[]} */
  const found = [];
  let level = NaN;
  for (let at = 0; at < xy_m.length; at += 1) {
    const next = levelOf(sigma_m[at]);
    if (next !== level) {
      if (found.length > 0 && !Number.isNaN(level)) found[found.length - 1].points.push(xy_m[at]);
      if (!Number.isNaN(next)) found.push({ sigma_m: STEP_OF_SIGMA ** next, points: [xy_m[at]] });
    } else if (!Number.isNaN(next)) {
      found[found.length - 1].points.push(xy_m[at]);
    }
    level = next;
  }
  return found;
}

/** @param {number | null | undefined} sigma_m @returns {number} NaN where nothing is known */
function levelOf(sigma_m) {
  if (sigma_m === null || sigma_m === undefined || !(sigma_m > 0)) return NaN;
  return Math.round(Math.log(sigma_m) / Math.log(STEP_OF_SIGMA));
}

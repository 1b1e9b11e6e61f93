/** What is shown of a walk that is being located: the last fix, and where it came along. Pure. */

/** @typedef {import("./words.js").Fix} Fix */
/**
 * @typedef {object} Trail
 * @property {Fix | null} fix the last one
 * @property {Fix | null} placed the last one that has a place
 * @property {[number, number][][]} pieces lines without what lies between two places of which nothing is known
 * @property {number} count fixes with a place
 * @property {number} total fixes in all
 */

/** So many places are remembered: an hour's walk. */
const LONGEST = 7200;
/** Nobody takes such a step: the walker has been found anew. */
const LEAP_M = 2.5;

/** @type {Trail} */
export const NO_TRAIL = { fix: null, placed: null, pieces: [], count: 0, total: 0 };

/** @param {Trail} trail @param {Fix} fix @returns {Trail} */
export function withFix(trail, fix) {
  const total = trail.total + 1;
  if (!fix.xyM) return { ...trail, fix, total };
  const isOn = trail.fix?.xyM && distance(trail.fix.xyM, fix.xyM) < LEAP_M;
  const before = isOn ? trail.pieces.slice(0, -1) : trail.pieces;
  const last = isOn ? [...trail.pieces[trail.pieces.length - 1], fix.xyM] : [fix.xyM];
  return { fix, placed: fix, pieces: shortened([...before, last]), count: trail.count + 1, total };
}

/** @param {[number, number][][]} pieces */
function shortened(pieces) {
  let over = pieces.reduce((sum, piece) => sum + piece.length, 0) - LONGEST;
  if (over <= 0) return pieces;
  const kept = [];
  for (const piece of pieces) {
    const rest = piece.slice(Math.max(over, 0));
    over -= piece.length;
    if (rest.length > 0) kept.push(rest);
  }
  return kept;
}

/** @param {[number, number]} a @param {[number, number]} b */
function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

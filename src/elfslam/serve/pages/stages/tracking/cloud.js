/** Guesses of where the walker is: how they are shared out, drawn again and gathered. */

/**
 * @typedef {import("./random.js").Random} Random
 * @typedef {{poses: Float64Array, scale: Float64Array, weight: Float64Array}} Cloud
 *   pose (3p), how much longer the steps are than reckoned (p), and weight (p), of sum 1
 */

/**
 * Even shares of [0, 1), all shifted by one draw.
 * @param {number} count @param {Random} random @returns {Float64Array}
 */
export function strata(count, random) {
  const shift = random.uniform();
  return Float64Array.from({ length: count }, (_, k) => (k + shift) / Math.max(count, 1));
}

/** @param {Float64Array} values @returns {Float64Array} their sums up to each */
export function cumulated(values) {
  let sum = 0;
  return values.map((value) => (sum += value));
}

/**
 * The rows that shares of a total fall to.
 * @param {Float64Array} sums cumulated @param {Float64Array} shares increasing, in [0, 1)
 * @returns {Int32Array}
 */
export function rowsAt(sums, shares) {
  const last = sums.length - 1;
  const rows = new Int32Array(shares.length);
  for (let k = 0, row = 0; k < shares.length; k += 1) {
    const wanted = sums[last] * shares[k];
    while (row < last && sums[row] < wanted) row += 1;
    rows[k] = row;
  }
  return rows;
}

/** @param {number} count @returns {Float64Array} */
export function evenWeights(count) {
  return new Float64Array(count).fill(1 / count);
}

/**
 * The guesses in the order of the cells they lie in, row of cells by row, so that neighbours lie side by side.
 * @param {Cloud} cloud @param {number} sizeM @returns {Int32Array}
 */
export function byCell({ poses, weight }, sizeM) {
  const [across, up] = [new Float64Array(weight.length), new Float64Array(weight.length)];
  for (let k = 0; k < weight.length; k += 1) {
    across[k] = Math.floor(poses[3 * k] / sizeM);
    up[k] = Math.floor(poses[3 * k + 1] / sizeM);
  }
  const order = Int32Array.from(weight, (_, k) => k);
  return order.sort((a, b) => up[a] - up[b] || across[a] - across[b] || a - b);
}

/**
 * The place with the most weight around it: the heaviest cell, moved to its middle.
 * @param {Cloud} cloud @param {number} nearM @returns {[number, number]}
 */
export function densest({ poses, weight }, nearM) {
  const heaviest = heaviestCell(poses, weight, nearM);
  const isInside = (/** @type {number} */ k) => cellOf(poses, k, nearM) === heaviest;
  const first = middleOf(poses, weight, isInside);
  return middleOf(poses, weight, (k) => isNear(poses, k, first, nearM));
}

/**
 * @param {Float64Array} poses @param {number} k @param {[number, number]} place @param {number} nearM
 * @returns {boolean} whether guess k lies within a distance of a place
 */
export function isNear(poses, k, [x, y], nearM) {
  return Math.sqrt((poses[3 * k] - x) ** 2 + (poses[3 * k + 1] - y) ** 2) <= nearM;
}

const CELLS = 2 ** 24;

/**
 * One number per cell that grows with x, then with y.
 * @param {Float64Array} poses @param {number} k @param {number} sizeM
 */
function cellOf(poses, k, sizeM) {
  return Math.floor(poses[3 * k] / sizeM) * CELLS + Math.floor(poses[3 * k + 1] / sizeM);
}

/**
 * Of cells of equal weight the first in x, then in y.
 * @param {Float64Array} poses @param {Float64Array} weight @param {number} sizeM
 */
function heaviestCell(poses, weight, sizeM) {
  const weights = new Map();
  for (let k = 0; k < weight.length; k += 1) {
    const cell = cellOf(poses, k, sizeM);
    weights.set(cell, (weights.get(cell) ?? 0) + weight[k]);
  }
  let [best, most] = [Infinity, -1];
  for (const [cell, sum] of weights) {
    if (sum > most || (sum === most && cell < best)) [best, most] = [cell, sum];
  }
  return best;
}

/**
 * @param {Float64Array} poses @param {Float64Array} weight @param {(k: number) => boolean} isInside
 * @returns {[number, number]}
 */
function middleOf(poses, weight, isInside) {
  let [x, y, sum] = [0, 0, 0];
  for (let k = 0; k < weight.length; k += 1) {
    if (!isInside(k)) continue;
    x += weight[k] * poses[3 * k];
    y += weight[k] * poses[3 * k + 1];
    sum += weight[k];
  }
  return [x / sum, y / sum];
}

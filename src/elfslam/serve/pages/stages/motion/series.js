/** Values over time, as numpy treats them: rounding, medians, differences and interpolation. */

/** @param {number} value @returns {number} the nearest whole number, halves to the even one */
export function roundHalfEven(value) {
  const below = Math.floor(value);
  const over = value - below;
  if (over !== 0.5) return Math.round(value);
  return below % 2 === 0 ? below : below + 1;
}

/** @param {ArrayLike<number>} values @returns {number} NaN where there are none */
export function median(values) {
  const sorted = Float64Array.from(values).sort();
  const middle = sorted.length >> 1;
  if (sorted.length === 0) return NaN;
  return sorted.length % 2 ? sorted[middle] : (sorted[middle - 1] + sorted[middle]) / 2;
}

/** @param {ArrayLike<number>} values (n) @returns {Float64Array} (n-1) */
export function differences(values) {
  return Float64Array.from({ length: Math.max(values.length - 1, 0) }, (_, k) => values[k + 1] - values[k]);
}

/** @param {ArrayLike<number>} values (n) @returns {Float64Array} (n-1) the middle of each and the next */
export function halfways(values) {
  return Float64Array.from({ length: Math.max(values.length - 1, 0) }, (_, k) => (values[k + 1] + values[k]) / 2);
}

/** @param {ArrayLike<number>} sorted @param {number} value @returns {number} how many are not above it */
function countUpTo(sorted, value) {
  let low = 0;
  let high = sorted.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (sorted[middle] <= value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * Values at a time, linear between the rows and constant beyond them.
 * @param {number} atS @param {ArrayLike<number>} tS increasing @param {ArrayLike<number>} values
 */
export function interpolate(atS, tS, values) {
  const next = countUpTo(tS, atS);
  if (next === 0) return values[0];
  if (next === tS.length) return values[next - 1];
  const slope = (values[next] - values[next - 1]) / (tS[next] - tS[next - 1]);
  return values[next - 1] + slope * (atS - tS[next - 1]);
}

/**
 * The same at many times.
 * @param {ArrayLike<number>} times increasing @param {ArrayLike<number>} tS @param {ArrayLike<number>} values
 * @returns {Float64Array}
 */
export function interpolateAll(times, tS, values) {
  const out = new Float64Array(times.length);
  const last = tS.length - 1;
  for (let k = 0, row = 0; k < out.length; k += 1) {
    while (row < last && tS[row + 1] <= times[k]) row += 1;
    if (row === last || times[k] < tS[0]) {
      out[k] = values[row];
      continue;
    }
    const slope = (values[row + 1] - values[row]) / (tS[row + 1] - tS[row]);
    out[k] = values[row] + slope * (times[k] - tS[row]);
  }
  return out;
}

/** @param {ArrayLike<number>} rows (3n) x, y, z by turns @returns {Float64Array[]} a column per axis */
export function columnsOf(rows) {
  const count = rows.length / 3;
  return [0, 1, 2].map((axis) => Float64Array.from({ length: count }, (_, k) => rows[3 * k + axis]));
}

/** @param {number} angleRad @returns {number} the same angle in [-pi, pi) */
export function wrapAngle(angleRad) {
  const full = 2 * Math.PI;
  const turned = (angleRad + Math.PI) % full;
  return (turned < 0 ? turned + full : turned) - Math.PI;
}

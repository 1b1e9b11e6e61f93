/** One-shot localization as elfslam.stages.locate does it: a few echoes against a map. */

import { ELF_SIZE } from "./constants.js";

/**
 * @typedef {"OK" | "AMBIGUOUS" | "UNKNOWN_PLACE" | "NO_ECHO" | "SUSPECT"} Status
 * @typedef {{tS: number, xyM: [number, number] | null, headingRad: number,
 *   covarianceM2: [number, number, number] | null, score: number, status: Status}} Fix
 *   covarianceM2: xx, xy, yy
 * @typedef {{unknown_below: number, temperature: number, near_m: number, ambiguous_below: number,
 *   sigma_floor_m: number, window_s: number, fewest_echoes: number}} LocateParameters the group `locate`
 */

/**
 * The mean (128) of the unit vectors from row `from` to `to`, without the last; not renormalised.
 * @param {Float32Array} vectors (n, 128) @param {number} from @param {number} to
 */
export function meanOf(vectors, from, to) {
  const sum = new Float64Array(ELF_SIZE);
  for (let k = from * ELF_SIZE; k < to * ELF_SIZE; k += 1) sum[k % ELF_SIZE] += vectors[k];
  return Float32Array.from(sum, (value) => value / (to - from));
}

/**
 * How alike each spot (m) is to a mean feature (128): the cosine of the two.
 * @param {Float32Array} mean
 * @param {import("./floor_map.js").FloorMap} floorMap
 * @returns {Float32Array}
 */
export function similarity(mean, { vectors }) {
  const length = Math.max(Math.sqrt(mean.reduce((sum, value) => sum + value * value, 0)), 1e-9);
  const direction = mean.map((value) => value / length);
  const scores = new Float32Array(vectors.length / ELF_SIZE);
  for (let spot = 0; spot < scores.length; spot += 1) {
    let dot = 0;
    let square = 0;
    for (let d = 0, at = spot * ELF_SIZE; d < ELF_SIZE; d += 1, at += 1) {
      dot += vectors[at] * direction[d];
      square += vectors[at] * vectors[at];
    }
    scores[spot] = dot / Math.max(Math.sqrt(square), 1e-9);
  }
  return scores;
}

/**
 * The fix at `tS` from how alike each spot is then; null where too little was heard.
 * Belief over the spots falls exponentially with their similarity; the fix is its mean near the best spot
 * and the covariance its spread there, plus the spot's own.
 * @param {Float32Array | null} scores (m)
 * @param {import("./floor_map.js").FloorMap} floorMap
 * @param {LocateParameters} parameters
 * @param {number} tS the middle of the echoes used
 * @returns {Fix}
 */
export function fixOf(scores, floorMap, parameters, tS = NaN) {
  if (scores === null) return nowhere(tS, NaN, "NO_ECHO");
  const best = greatest(scores);
  if (scores[best] < parameters.unknown_below) return nowhere(tS, scores[best], "UNKNOWN_PLACE");
  const belief = beliefOf(scores, scores[best], parameters.temperature);
  const near = spotsNear(floorMap, best, parameters.near_m);
  const clear = sumOf(belief, near) >= parameters.ambiguous_below * sumOf(belief, belief.keys());
  const used = clear ? near : [...belief.keys()];
  const { xyM, headingRad, spread } = meanPlace(floorMap, belief, used);
  const [xx, xy, yy] = floorMap.covarianceM2.subarray(3 * best, 3 * best + 3);
  const floorM2 = parameters.sigma_floor_m ** 2;
  /** @type {[number, number, number]} */
  const covarianceM2 = [spread[0] + xx + floorM2, spread[1] + xy, spread[2] + yy + floorM2];
  return { tS, xyM, headingRad, covarianceM2, score: scores[best], status: clear ? "OK" : "AMBIGUOUS" };
}

/** @param {number} tS @param {number} score @param {Status} status @returns {Fix} */
function nowhere(tS, score, status) {
  return { tS, xyM: null, headingRad: NaN, covarianceM2: null, score, status };
}

/** @param {ArrayLike<number>} values @returns {number} which one it is */
export function greatest(values) {
  let best = 0;
  for (let k = 1; k < values.length; k += 1) if (values[k] > values[best]) best = k;
  return best;
}

/** @param {Float32Array} scores @param {number} highest @param {number} temperature */
function beliefOf(scores, highest, temperature) {
  return Float64Array.from(scores, (score) => Math.exp((score - highest) / temperature));
}

/** @param {import("./floor_map.js").FloorMap} floorMap @param {number} spot @param {number} nearM */
function spotsNear({ xyM }, spot, nearM) {
  const near = [];
  for (let k = 0; 2 * k < xyM.length; k += 1) {
    const [dx, dy] = [xyM[2 * k] - xyM[2 * spot], xyM[2 * k + 1] - xyM[2 * spot + 1]];
    if (Math.sqrt(dx * dx + dy * dy) <= nearM) near.push(k);
  }
  return near;
}

/** @param {Float64Array} values @param {Iterable<number>} indices */
function sumOf(values, indices) {
  let sum = 0;
  for (const k of indices) sum += values[k];
  return sum;
}

/**
 * Where belief lies among some spots, its spread there (xx, xy, yy), and where it faces.
 * @param {import("./floor_map.js").FloorMap} floorMap @param {Float64Array} belief @param {number[]} used
 * @returns {{xyM: [number, number], headingRad: number, spread: number[]}}
 */
function meanPlace({ xyM, headingRad }, belief, used) {
  const total = sumOf(belief, used);
  /** @param {(k: number) => number} valueOf */
  const mean = (valueOf) => used.reduce((sum, k) => sum + belief[k] * valueOf(k), 0) / total;
  const x = mean((k) => xyM[2 * k]);
  const y = mean((k) => xyM[2 * k + 1]);
  const spread = [
    mean((k) => (xyM[2 * k] - x) ** 2),
    mean((k) => (xyM[2 * k] - x) * (xyM[2 * k + 1] - y)),
    mean((k) => (xyM[2 * k + 1] - y) ** 2),
  ];
  const [cos, sin] = [mean((k) => Math.cos(headingRad[k])), mean((k) => Math.sin(headingRad[k]))];
  return { xyM: [x, y], headingRad: Math.atan2(sin, cos), spread };
}

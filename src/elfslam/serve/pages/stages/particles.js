/** Particles of where the walker is: drawn from echoes, moved by footsteps, weighed by echoes, drawn again. */

import { roundHalfEven, wrapAngle } from "./motion/filters.js";

/**
 * @typedef {import("./track.js").TrackParameters} TrackParameters
 * @typedef {ReturnType<typeof import("./nearest.js").nearestIn>} Nearest
 */

/**
 * Spots where distance is counted in sigmas of position and heading.
 * @param {Spots} floorMap @param {TrackParameters} known @returns {Float64Array} (4m)
 */
export function placesOf({ xyM, headingRad }, { reach_m: reachM, heading_reach_rad: reachRad }) {
  const places = new Float64Array(4 * headingRad.length);
  for (let k = 0; k < headingRad.length; k += 1) {
    const [cos, sin] = [Math.cos(headingRad[k]), Math.sin(headingRad[k])];
    places.set([xyM[2 * k] / reachM, xyM[2 * k + 1] / reachM, cos / reachRad, sin / reachRad], 4 * k);
  }
  return places;
}

/**
 * Each particle moved by the step, with errors of its own.
 * @param {Cloud} cloud @param {ArrayLike<number>} move @param {ArrayLike<number>} sigma
 * @param {TrackParameters} known @param {Random} random @returns {Cloud}
 */
export function moved({ poses, scale, weight }, move, sigma, known, random) {
  const noise = Float64Array.from({ length: poses.length }, () => random.normal());
  const turn = Math.hypot(sigma[2], known.turn_sigma_rad);
  const out = new Float64Array(poses.length);
  for (let k = 0; k < weight.length; k += 1) {
    const forward = move[0] * scale[k] + noise[3 * k] * sigma[0];
    const left = move[1] * scale[k] + noise[3 * k + 1] * sigma[1];
    const turnRad = move[2] + noise[3 * k + 2] * turn;
    composeInto(out, k, poses[3 * k], poses[3 * k + 1], poses[3 * k + 2], forward, left, turnRad);
  }
  return { poses: out, scale, weight };
}

/**
 * Weights times likelihood: the best of the spots around, as near as it is.
 * @param {Cloud} cloud @param {Float64Array} middle poses in the middle of the step
 * @param {Float32Array} scores @param {Nearest} nearest @param {TrackParameters} known
 * @returns {Cloud}
 */
export function weighed({ poses, scale, weight }, middle, scores, nearest, known) {
  const likelihood = logLikelihood(middle, scores, nearest, known);
  const best = greatest(likelihood);
  const raised = weight.map((value, k) => value * Math.exp(likelihood[k] - best));
  const sum = raised.reduce((total, value) => total + value, 0);
  return { poses, scale, weight: raised.map((value) => value / sum) };
}

/**
 * @param {Float64Array} middle @param {Float32Array} scores @param {Nearest} nearest
 * @param {TrackParameters} known
 */
function logLikelihood(middle, scores, nearest, known) {
  const temperature = Math.fround(known.temperature);
  const explained = (/** @type {number} */ spot) => Math.fround(scores[spot] / temperature);
  const granted = known.unexplained / known.temperature;
  // A spot further than that explains less than is granted where no spot is near.
  const furthest = Math.sqrt(2 * Math.max(greatest(scores) / temperature - granted, 0)) + 1e-6;
  const out = new Float64Array(middle.length / 3);
  for (let k = 0; k < out.length; k += 1) {
    const cos = Math.cos(middle[3 * k + 2]) / known.heading_reach_rad;
    const sin = Math.sin(middle[3 * k + 2]) / known.heading_reach_rad;
    const [x, y] = [middle[3 * k] / known.reach_m, middle[3 * k + 1] / known.reach_m];
    const { found, indices, squares } = nearest(x, y, cos, sin, furthest);
    out[k] = granted;
    for (let n = 0; n < found; n += 1) out[k] = Math.max(out[k], explained(indices[n]) - squares[n] / 2);
  }
  return out;
}

/**
 * Particles from the echoes alone, after the step in whose middle they were heard.
 * @param {Spots} floorMap @param {Float32Array} scores @param {ArrayLike<number>} move @param {number} count
 * @param {TrackParameters} known @param {Random} random
 * @returns {Cloud}
 */
export function drawn({ xyM, headingRad }, scores, move, count, known, random) {
  const best = greatest(scores);
  const belief = Float64Array.from(scores, (score) => Math.exp(Math.fround(score - best) / known.temperature));
  const spots = rowsAt(cumulated(belief), strata(count, random));
  const aside = Float64Array.from({ length: 2 * count }, () => known.reach_m * random.normal());
  const poses = new Float64Array(3 * count);
  for (let k = 0; k < count; k += 1) {
    const spot = spots[k];
    const heading = headingRad[spot] + known.heading_reach_rad * random.normal();
    const [x, y] = [xyM[2 * spot] + aside[2 * k], xyM[2 * spot + 1] + aside[2 * k + 1]];
    composeInto(poses, k, x, y, heading, move[0] / 2, move[1] / 2, move[2] / 2);
  }
  const scale = Float64Array.from({ length: count }, () => 1 + known.scale_sigma * random.normal());
  return { poses, scale, weight: evenWeights(count) };
}

/**
 * As many particles, where they weigh, and some drawn from the echoes alone.
 * @param {Cloud} cloud @param {Spots} floorMap @param {Float32Array} scores @param {ArrayLike<number>} move
 * @param {TrackParameters} known @param {Random} random @returns {Cloud}
 */
export function renewed(cloud, floorMap, scores, move, known, random) {
  const count = known.particles;
  const fresh = roundHalfEven(known.renewed * count);
  const order = byCell(cloud, known.near_m);
  const sums = cumulated(Float64Array.from(order, (k) => cloud.weight[k]));
  const rows = rowsAt(sums, strata(count - fresh, random));
  const poses = new Float64Array(3 * count);
  const scale = new Float64Array(count);
  rows.forEach((row, k) => {
    const from = order[row];
    poses.set(cloud.poses.subarray(3 * from, 3 * from + 3), 3 * k);
    scale[k] = cloud.scale[from];
  });
  const young = drawn(floorMap, scores, move, fresh, known, random);
  poses.set(young.poses, 3 * (count - fresh));
  scale.set(young.scale, count - fresh);
  return { poses, scale, weight: evenWeights(count) };
}

/** @param {ArrayLike<number>} values */
function greatest(values) {
  let best = -Infinity;
  for (let k = 0; k < values.length; k += 1) if (values[k] > best) best = values[k];
  return best;
}

// Particles of where the walker is: how they are shared out, drawn again and gathered.

/**
 * @typedef {{poses: Float64Array, scale: Float64Array, weight: Float64Array}} Cloud
 *   pose (3p), how much longer the steps are than reckoned (p), and weight (p), of sum 1
 */

/**
 * Even shares of [0, 1), all shifted by one draw.
 * @param {number} count @param {Random} random @returns {Float64Array}
 */
function strata(count, random) {
  const shift = random.uniform();
  return Float64Array.from({ length: count }, (_, k) => (k + shift) / Math.max(count, 1));
}

/** @param {Float64Array} values @returns {Float64Array} their sums up to each */
function cumulated(values) {
  let sum = 0;
  return values.map((value) => (sum += value));
}

/**
 * The rows that shares of a total fall to.
 * @param {Float64Array} sums cumulated @param {Float64Array} shares increasing, in [0, 1)
 * @returns {Int32Array}
 */
function rowsAt(sums, shares) {
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
function evenWeights(count) {
  return new Float64Array(count).fill(1 / count);
}

/**
 * The particles in the order of the cells they lie in, row of cells by row, so that neighbours lie side by side.
 * @param {Cloud} cloud @param {number} sizeM @returns {Int32Array}
 */
function byCell({ poses, weight }, sizeM) {
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
 * @returns {boolean} whether particle k lies within a distance of a place
 */
function isNear(poses, k, [x, y], nearM) {
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

// What a cloud of particles says: the best place, how sure that is, and whether it is known at all.

/**
 * @typedef {import("./locate.js").Status} Status
 * @typedef {{xyM: ArrayLike<number>, headingRad: ArrayLike<number>, covarianceM2: Float32Array}} Spots
 *   (2m), (m) and (3m: xx, xy, yy), as in a floor map
 * @typedef {{xyM: [number, number] | null, headingRad: number, covarianceM2: [number, number, number] | null,
 *   score: number, status: Status}} Fix without its time, which is that of the footstep
 * @typedef {{near: number[], belief: number, xyM: [number, number], headingRad: number}} Place
 *   particles near it, their weight, middle and heading
 */

/** @param {number} score @param {Status} status @returns {Fix} of a place that cannot be told */
export function nowhere(score, status) {
  return { xyM: null, headingRad: NaN, covarianceM2: null, score, status };
}

/**
 * The best place, from the particles near it, or as far as `reachOf` says.
 * @param {Cloud} cloud @param {{near_m: number}} known
 * @param {(poses: Float64Array, best: number[], nearM: number) => number} reachOf
 * @returns {Place}
 */
export function placeOf(cloud, known, reachOf = (poses, best, nearM) => nearM) {
  const { poses, weight } = cloud;
  const best = densest(cloud, known.near_m);
  const reachM = reachOf(poses, best, known.near_m);
  const near = [];
  let belief = 0;
  for (let k = 0; k < weight.length; k += 1) {
    if (!isNear(poses, k, best, reachM)) continue;
    near.push(k);
    belief += weight[k];
  }
  let [x, y, cos, sin] = [0, 0, 0, 0];
  for (const k of near) {
    const share = weight[k] / belief;
    x += share * poses[3 * k];
    y += share * poses[3 * k + 1];
    cos += share * Math.cos(poses[3 * k + 2]);
    sin += share * Math.sin(poses[3 * k + 2]);
  }
  return { near, belief, xyM: [x, y], headingRad: Math.atan2(sin, cos) };
}

/**
 * The spot closest to a place, and how alike the most alike of those near it is: -1 where none is.
 * @param {Spots} floorMap @param {number[]} xyM @param {Float32Array | null} scores @param {number} nearM
 * @returns {{closest: number, similarity: number}}
 */
export function aroundOf({ xyM, headingRad }, [x, y], scores, nearM) {
  let [closest, least, similarity] = [0, Infinity, -1];
  for (let k = 0; k < headingRad.length; k += 1) {
    const away = Math.sqrt((xyM[2 * k] - x) ** 2 + (xyM[2 * k + 1] - y) ** 2);
    if (away < least) [closest, least] = [k, away];
    if (scores && away <= nearM && scores[k] > similarity) similarity = scores[k];
  }
  return { closest, similarity };
}

/**
 * @param {Cloud} cloud @param {Place} place @param {Float32Array} ownM2 covariance of the spot closest to it
 * @param {{sigma_floor_m: number}} known
 * @returns {[number, number, number]} xx, xy, yy: the spread of the particles near it, the spot's own and the least
 */
export function covarianceOf({ poses, weight }, { near, belief, xyM }, ownM2, known) {
  let [xx, xy, yy] = ownM2;
  for (const k of near) {
    const share = weight[k] / belief;
    const [dx, dy] = [poses[3 * k] - xyM[0], poses[3 * k + 1] - xyM[1]];
    xx += share * dx * dx;
    xy += share * dx * dy;
    yy += share * dy * dy;
  }
  return [xx + known.sigma_floor_m ** 2, xy, yy + known.sigma_floor_m ** 2];
}

// Planar poses x m, y m, heading rad, as rows (3p): elfslam.base.geometry.

/**
 * Writes row k of a_from_c: the pose a_from_b of that row and what follows it.
 * @param {Float64Array} out (3p) @param {number} k
 * @param {number} x @param {number} y @param {number} headingRad a_from_b
 * @param {number} forward @param {number} left @param {number} turnRad b_from_c
 */
function composeInto(out, k, x, y, headingRad, forward, left, turnRad) {
  const [cos, sin] = [Math.cos(headingRad), Math.sin(headingRad)];
  out[3 * k] = x + cos * forward - sin * left;
  out[3 * k + 1] = y + sin * forward + cos * left;
  out[3 * k + 2] = wrapAngle(headingRad + turnRad);
}

/** Poses in the middle of a step. @param {Float64Array} before (3p) @param {Float64Array} after (3p) */
export function halfwayBetween(before, after) {
  const middle = new Float64Array(before.length);
  for (let k = 0; k < before.length; k += 3) {
    middle[k] = (before[k] + after[k]) / 2;
    middle[k + 1] = (before[k + 1] + after[k + 1]) / 2;
    middle[k + 2] = before[k + 2] + wrapAngle(after[k + 2] - before[k + 2]) / 2;
  }
  return middle;
}

/** All poses moved alike. @param {Float64Array} poses (3p) @param {number[]} move (3) @returns {Float64Array} */
export function movedBy(poses, move) {
  const out = new Float64Array(poses.length);
  const [forward, left, turn] = move;
  for (let k = 0; 3 * k < poses.length; k += 1) {
    composeInto(out, k, poses[3 * k], poses[3 * k + 1], poses[3 * k + 2], forward, left, turn);
  }
  return out;
}

// Chance for a tracker that must give the same fixes for the same seed.

/** @typedef {{uniform: () => number, normal: () => number}} Random */

/**
 * Sfc32 (Doty-Humphrey's small fast counting generator) for uniform draws in [0, 1), and Marsaglia's polar
 * method for normal ones.
 * @param {number} seed a whole number below 2^32
 * @returns {Random}
 */
export function makeRandom(seed) {
  const next = sfc32(seed >>> 0);
  const uniform = () => next() / 2 ** 32;
  let spare = NaN;
  const normal = () => {
    if (!Number.isNaN(spare)) {
      const kept = spare;
      spare = NaN;
      return kept;
    }
    const [x, y, square] = insideCircle(uniform);
    const scale = Math.sqrt((-2 * Math.log(square)) / square);
    spare = y * scale;
    return x * scale;
  };
  return { uniform, normal };
}

/** @param {() => number} uniform */
function insideCircle(uniform) {
  for (;;) {
    const [x, y] = [2 * uniform() - 1, 2 * uniform() - 1];
    const square = x * x + y * y;
    if (square > 0 && square < 1) return [x, y, square];
  }
}

/** @param {number} seed */
function sfc32(seed) {
  let [a, b, c, counter] = [seed, 0, 0, 1];
  const next = () => {
    const drawn = (a + b + counter) | 0;
    counter = (counter + 1) | 0;
    a = b ^ (b >>> 9);
    b = (c + (c << 3)) | 0;
    c = ((c << 21) | (c >>> 11)) + drawn | 0;
    return drawn >>> 0;
  };
  for (let k = 0; k < 12; k += 1) next();
  return next;
}

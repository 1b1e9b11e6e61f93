/** Guesses of where the walker is: drawn from echoes, moved by footsteps, weighed by echoes, drawn again. */

import { roundHalfEven } from "../motion/series.js";
import { byCell, cumulated, evenWeights, rowsAt, strata } from "./cloud.js";
import { composeInto } from "./poses.js";

/**
 * @typedef {import("./cloud.js").Cloud} Cloud
 * @typedef {import("./random.js").Random} Random
 * @typedef {import("./fix.js").Spots} Spots
 * @typedef {import("../track.js").TrackParameters} TrackParameters
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
 * Each guess moved by the step, with errors of its own.
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
 * Guesses from the echoes alone, after the step in whose middle they were heard.
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
 * As many guesses, where they weigh, and some drawn from the echoes alone.
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

/** What a cloud of guesses says: the best place, how sure that is, and whether it is known at all. */

import { densest, isNear } from "./cloud.js";

/**
 * @typedef {import("./cloud.js").Cloud} Cloud
 * @typedef {import("../locate.js").Status} Status
 * @typedef {{xyM: ArrayLike<number>, headingRad: ArrayLike<number>, covarianceM2: Float32Array}} Spots
 *   (2m), (m) and (3m: xx, xy, yy), as in a floor map
 * @typedef {{xyM: [number, number] | null, headingRad: number, covarianceM2: [number, number, number] | null,
 *   score: number, status: Status}} Fix without its time, which is that of the footstep
 * @typedef {{near: number[], belief: number, xyM: [number, number], headingRad: number}} Place
 *   guesses near it, their weight, middle and heading
 */

/** @param {number} score @param {Status} status @returns {Fix} of a place that cannot be told */
export function nowhere(score, status) {
  return { xyM: null, headingRad: NaN, covarianceM2: null, score, status };
}

/**
 * The best place, from the guesses near it, or as far as `reachOf` says.
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
 * @returns {{closest: number, likeness: number}}
 */
export function aroundOf({ xyM, headingRad }, [x, y], scores, nearM) {
  let [closest, least, likeness] = [0, Infinity, -1];
  for (let k = 0; k < headingRad.length; k += 1) {
    const away = Math.sqrt((xyM[2 * k] - x) ** 2 + (xyM[2 * k + 1] - y) ** 2);
    if (away < least) [closest, least] = [k, away];
    if (scores && away <= nearM && scores[k] > likeness) likeness = scores[k];
  }
  return { closest, likeness };
}

/**
 * @param {Cloud} cloud @param {Place} place @param {Float32Array} ownM2 covariance of the spot closest to it
 * @param {{sigma_floor_m: number}} known
 * @returns {[number, number, number]} xx, xy, yy: the spread of the guesses near it, the spot's own and the least
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

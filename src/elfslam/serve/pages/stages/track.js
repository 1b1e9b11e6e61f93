/**
 * A live tracker: many particles of where the walker is, moved by footsteps and weighed by echoes. The same,
 * draw by draw, as elfslam.stages.track.
 */

import { nearestIn, treeOf } from "./nearest.js";
import {
  aroundOf, covarianceOf, densest, drawn, halfwayBetween, moved, movedBy, nowhere, placeOf, placesOf, renewed,
  weighed,
} from "./particles.js";

/**
 * @typedef {import("./particles.js").Cloud} Cloud
 * @typedef {import("./particles.js").Fix} Fix
 * @typedef {import("./particles.js").Spots} Spots
 * @typedef {import("./particles.js").Random} Random
 * @typedef {import("./locate.js").Status} Status
 * @typedef {{cloud: Cloud, middle: Float64Array}} Updated middle: poses in the middle of the step
 * @typedef {{
 *   ambiguous_below: number, heading_reach_rad: number, jump: number, memory: number,
 *   near_m: number, neighbours: number, particles: number, reach_m: number, regained: number,
 *   renewed: number, scale_sigma: number, settled: number, sigma_floor_m: number, temperature: number,
 *   turn_sigma_rad: number, unexplained: number, unknown_below: number,
 * }} TrackParameters the group "track", as far as pages need it
 */

/**
 * Follows one walker through a map. `step(move, sigma, scores, isSuspect)` takes a step's move and sigma, and
 * how alike each spot (m) is to what was heard meanwhile, or null (or NaN) where nothing was; it gives a Fix.
 * What is suspect, or says of a settled walker what no step explains, is SUSPECT and moves nothing.
 * @param {Spots} floorMap
 * @param {TrackParameters} parameters
 * @param {Random} random
 * @returns {{step: (move: ArrayLike<number>, sigma: ArrayLike<number>, scores: Float32Array | null,
 *   isSuspect?: boolean) => Fix}}
 */
export function makeTracker(floorMap, parameters, random) {
  const count = Math.min(parameters.neighbours, floorMap.headingRad.length);
  const nearest = nearestIn(treeOf(placesOf(floorMap, parameters)), count);
  /** @type {Cloud | null} */
  let cloud = null;
  let smoothed = NaN;
  let settled = 0;
  let isDoubting = false;

  /**
   * @param {ArrayLike<number>} move @param {ArrayLike<number>} sigma @param {Float32Array | null} given
   * @returns {Fix}
   */
  const step = (move, sigma, given, isSuspect = false) => {
    const scores = given && !Number.isNaN(given[0]) && !isSuspect ? given : null;
    if (cloud === null && scores === null) return nowhere(NaN, isSuspect ? "SUSPECT" : "NO_ECHO");
    const isFirst = cloud === null;
    const after = updated(cloud, move, sigma, scores);
    if (isSuspect) isDoubting = true;
    else if (scores && !isFirst) isDoubting = isJump(after, scores);
    if (isSuspect || (scores && isDoubting)) {
      cloud = after.cloud;
      return fixed(cloud, null, "SUSPECT");
    }
    cloud = scores ? weighed(after.cloud, after.middle, scores, nearest, parameters) : after.cloud;
    const fix = fixed(cloud, scores, "NO_ECHO");
    if (scores) cloud = renewed(cloud, floorMap, scores, move, parameters, random);
    settled += fix.status === "OK" ? 1 : 0;
    return fix;
  };
  /** @param {Updated} after @param {Float32Array} scores */
  const isJump = ({ cloud: { scale, weight }, middle }, scores) => {
    if (settled < parameters.settled) return false;
    const further = furtherSimilarity({ poses: middle, scale, weight }, floorMap, scores, parameters.near_m);
    return further > (isDoubting ? parameters.regained : parameters.jump);
  };
  /**
   * Without a cloud before there are scores.
   * @param {Cloud | null} before @param {ArrayLike<number>} move @param {ArrayLike<number>} sigma
   * @param {Float32Array | null} scores @returns {Updated}
   */
  const updated = (before, move, sigma, scores) => {
    if (before === null) {
      const heard = /** @type {Float32Array} */ (scores);
      const first = drawn(floorMap, heard, move, parameters.particles, parameters, random);
      return { cloud: first, middle: movedBy(first.poses, [-move[0] / 2, -move[1] / 2, -move[2] / 2]) };
    }
    const after = moved(before, move, sigma, parameters, random);
    return { cloud: after, middle: halfwayBetween(before.poses, after.poses) };
  };
  /** @param {Cloud} particles @param {Float32Array | null} scores @param {Status} unheard @returns {Fix} */
  const fixed = (particles, scores, unheard) => {
    const place = placeOf(particles, parameters, unheard === "SUSPECT" ? reachOf : undefined);
    const around = aroundOf(floorMap, place.xyM, scores, parameters.near_m);
    if (scores) smoothed = remembered(smoothed, around.similarity, parameters.memory);
    const isSuspect = unheard === "SUSPECT" && !scores;
    if (isSuspect && settled < parameters.settled) return nowhere(smoothed, "SUSPECT");
    if (!isSuspect && smoothed < parameters.unknown_below) return nowhere(smoothed, "UNKNOWN_PLACE");
    const own = floorMap.covarianceM2.slice(3 * around.closest, 3 * around.closest + 3);
    const covarianceM2 = covarianceOf(particles, place, own, parameters);
    const certain = place.belief < parameters.ambiguous_below ? "AMBIGUOUS" : "OK";
    const status = scores ? certain : unheard;
    return { xyM: place.xyM, headingRad: place.headingRad, covarianceM2, score: smoothed, status };
  };
  return { step };
}

/** @param {number} past @param {number} smoothed @param {number} memory */
function remembered(past, smoothed, memory) {
  return memory * (Number.isNaN(past) ? smoothed : past) + (1 - memory) * smoothed;
}

// Whether a walker is heard where no step can have led.

/**
 * How far from the best place particles may reach: twice as far as half of them, and a little.
 * @param {Float64Array} poses (3p) @param {number[]} best (2) @param {number} nearM @returns {number}
 */
export function reachOf(poses, [x, y], nearM) {
  const away = new Float64Array(poses.length / 3);
  for (let k = 0; k < away.length; k += 1) {
    away[k] = Math.sqrt((poses[3 * k] - x) ** 2 + (poses[3 * k + 1] - y) ** 2);
  }
  away.sort();
  const half = away.length >> 1;
  const median = away.length % 2 ? away[half] : (away[half - 1] + away[half]) / 2;
  return nearM / 2 + 2 * median;
}

/**
 * How much more alike some place is than all within reach of the particles.
 * @param {import("./particles.js").Cloud} cloud particles in the middle of the step
 * @param {import("./particles.js").Spots} floorMap @param {Float32Array} scores @param {number} nearM
 * @returns {number}
 */
function furtherSimilarity(cloud, { xyM }, scores, nearM) {
  const [x, y] = densest(cloud, nearM);
  const reachM = reachOf(cloud.poses, [x, y], nearM);
  let [here, anywhere] = [-1, -Infinity];
  for (let k = 0; k < scores.length; k += 1) {
    anywhere = Math.max(anywhere, scores[k]);
    const away = Math.sqrt((xyM[2 * k] - x) ** 2 + (xyM[2 * k + 1] - y) ** 2);
    if (away <= reachM) here = Math.max(here, scores[k]);
  }
  return anywhere - here;
}

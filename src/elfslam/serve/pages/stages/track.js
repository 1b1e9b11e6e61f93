/**
 * A live tracker: many guesses of where the walker is, moved by footsteps and weighed by echoes. The same,
 * draw by draw, as elfslam.stages.track.
 */

import { aroundOf, covarianceOf, nowhere, placeOf } from "./tracking/fix.js";
import { drawn, moved, placesOf, renewed, weighed } from "./tracking/guesses.js";
import { furtherLikeness, reachOf } from "./tracking/jumping.js";
import { nearestIn, treeOf } from "./tracking/nearest.js";
import { halfwayBetween, movedBy } from "./tracking/poses.js";

/**
 * @typedef {import("./tracking/cloud.js").Cloud} Cloud
 * @typedef {import("./tracking/fix.js").Fix} Fix
 * @typedef {import("./tracking/fix.js").Spots} Spots
 * @typedef {import("./tracking/random.js").Random} Random
 * @typedef {import("./locate.js").Status} Status
 * @typedef {{cloud: Cloud, middle: Float64Array}} Guessed middle: poses in the middle of the step
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
  let likeness = NaN;
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
    const after = guessed(cloud, move, sigma, scores);
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
  /** @param {Guessed} after @param {Float32Array} scores */
  const isJump = ({ cloud: { scale, weight }, middle }, scores) => {
    if (settled < parameters.settled) return false;
    const further = furtherLikeness({ poses: middle, scale, weight }, floorMap, scores, parameters.near_m);
    return further > (isDoubting ? parameters.regained : parameters.jump);
  };
  /**
   * Without a cloud before there are scores.
   * @param {Cloud | null} before @param {ArrayLike<number>} move @param {ArrayLike<number>} sigma
   * @param {Float32Array | null} scores @returns {Guessed}
   */
  const guessed = (before, move, sigma, scores) => {
    if (before === null) {
      const heard = /** @type {Float32Array} */ (scores);
      const first = drawn(floorMap, heard, move, parameters.particles, parameters, random);
      return { cloud: first, middle: movedBy(first.poses, [-move[0] / 2, -move[1] / 2, -move[2] / 2]) };
    }
    const after = moved(before, move, sigma, parameters, random);
    return { cloud: after, middle: halfwayBetween(before.poses, after.poses) };
  };
  /** @param {Cloud} guesses @param {Float32Array | null} scores @param {Status} unheard @returns {Fix} */
  const fixed = (guesses, scores, unheard) => {
    const place = placeOf(guesses, parameters, unheard === "SUSPECT" ? reachOf : undefined);
    const around = aroundOf(floorMap, place.xyM, scores, parameters.near_m);
    if (scores) likeness = remembered(likeness, around.likeness, parameters.memory);
    const isSuspect = unheard === "SUSPECT" && !scores;
    if (isSuspect && settled < parameters.settled) return nowhere(likeness, "SUSPECT");
    if (!isSuspect && likeness < parameters.unknown_below) return nowhere(likeness, "UNKNOWN_PLACE");
    const own = floorMap.covarianceM2.slice(3 * around.closest, 3 * around.closest + 3);
    const covarianceM2 = covarianceOf(guesses, place, own, parameters);
    const certain = place.belief < parameters.ambiguous_below ? "AMBIGUOUS" : "OK";
    const status = scores ? certain : unheard;
    return { xyM: place.xyM, headingRad: place.headingRad, covarianceM2, score: likeness, status };
  };
  return { step };
}

/** @param {number} past @param {number} likeness @param {number} memory */
function remembered(past, likeness, memory) {
  return memory * (Number.isNaN(past) ? likeness : past) + (1 - memory) * likeness;
}

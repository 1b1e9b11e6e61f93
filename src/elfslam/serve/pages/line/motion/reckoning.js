/** Dead reckoning: steps and heading put together, a pose per footstep: elfslam.line.motion.reckoning. */

import { footfalls, verticalBounce } from "./footsteps.js";
import { smoothHeading, turnedSinceRest } from "./heading.js";
import { lengthsBetween } from "./lengths.js";
import { checkImu, level } from "./level.js";
import { halfways, interpolateAll, wrapAngle } from "./series.js";

/** @typedef {import("./types.js").MotionParameters} MotionParameters */

/**
 * One node per footstep, with the sigma of each move.
 * @param {import("./types.js").Imu} imu
 * @param {MotionParameters} parameters
 * @param {number[]} startPose where the walker stood, and faced, as the recording began
 * @returns {import("./types.js").Odometry}
 * Throws where the recording is too short, too slow, interrupted, or holds too few footsteps.
 */
export function deadReckon(imu, parameters, startPose = [0, 0, 0]) {
  checkImu(imu, parameters);
  const levelled = level(imu, parameters);
  const bounce = verticalBounce(levelled, parameters);
  const footstepsS = footfalls(levelled, bounce, parameters);
  if (footstepsS.length < parameters.least_footsteps) {
    throw new RangeError(
      `inertial data: found ${footstepsS.length} footsteps, wanted at least ${parameters.least_footsteps}; `
      + "record a longer walk, phone in the hand",
    );
  }
  const lengthsM = lengthsBetween(levelled, bounce, footstepsS, parameters);
  const moves = movesBetween(levelled.tS, smoothHeading(levelled, parameters), footstepsS, lengthsM);
  const turnedRad = turnedSinceRest(levelled, bounce, footstepsS[0], parameters);
  const worldFromBody = chained(firstPose(startPose, turnedRad, lengthsM[0]), moves);
  return { tS: footstepsS, worldFromBody, stepSigma: stepSigma(lengthsM, parameters) };
}

/**
 * Moves (3 (n-1)) between n footsteps: each goes where the walker heads halfway through it.
 * @param {Float64Array} tS of the headings @param {Float64Array} headingRad
 * @param {Float64Array} footstepsS @param {Float64Array} lengthsM @returns {Float64Array}
 */
export function movesBetween(tS, headingRad, footstepsS, lengthsM) {
  const at = interpolateAll(footstepsS, tS, headingRad);
  const halfway = interpolateAll(halfways(footstepsS), tS, headingRad);
  const moves = new Float64Array(3 * lengthsM.length);
  lengthsM.forEach((lengthM, k) => moves.set(moveOf(lengthM, halfway[k] - at[k], at[k + 1] - at[k]), 3 * k));
  return moves;
}

/**
 * @param {number} lengthM @param {number} asideRad @param {number} turnRad
 * @returns {number[]} forward m, left m, turn rad
 */
export function moveOf(lengthM, asideRad, turnRad) {
  return [lengthM * Math.cos(asideRad), lengthM * Math.sin(asideRad), turnRad];
}

/**
 * The sigma of a move.
 * @param {number} lengthM @param {number} headingRad the sigma of its turn @param {MotionParameters} parameters
 * @returns {number[]}
 */
export function sigmaOf(lengthM, headingRad, parameters) {
  return [parameters.forward_sigma * lengthM, parameters.lateral_sigma * lengthM, headingRad];
}

/** Of the first step, which may point aside, too. @param {MotionParameters} parameters */
export function settingOffSigmaRad(parameters) {
  return Math.hypot(parameters.heading_sigma_rad, parameters.setting_off_sigma_rad);
}

/** @param {Float64Array} lengthsM @param {MotionParameters} parameters */
function stepSigma(lengthsM, parameters) {
  const sigma = new Float64Array(3 * lengthsM.length);
  lengthsM.forEach((lengthM, k) => {
    const headingRad = k ? parameters.heading_sigma_rad : settingOffSigmaRad(parameters);
    sigma.set(sigmaOf(lengthM, headingRad, parameters), 3 * k);
  });
  return sigma;
}

/**
 * Pose of the first footstep: half a step from where the walker stood.
 * @param {number[]} start @param {number | null} turnedRad @param {number} lengthM
 */
function firstPose(start, turnedRad, lengthM) {
  if (turnedRad === null) return start;
  const ahead = start[2] + turnedRad / 2;
  return [
    start[0] + (lengthM / 2) * Math.cos(ahead),
    start[1] + (lengthM / 2) * Math.sin(ahead),
    wrapAngle(start[2] + turnedRad),
  ];
}

/** Poses (3 (n+1)) reached from a start by moves (3n). @param {number[]} start @param {Float64Array} moves */
function chained(start, moves) {
  const poses = new Float64Array(moves.length + 3);
  let [x, y, heading] = start;
  poses.set([x, y, wrapAngle(heading)]);
  for (let k = 0; k < moves.length; k += 3) {
    const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
    x += cos * moves[k] - sin * moves[k + 1];
    y += sin * moves[k] + cos * moves[k + 1];
    heading += moves[k + 2];
    poses.set([x, y, wrapAngle(heading)], k + 3);
  }
  return poses;
}

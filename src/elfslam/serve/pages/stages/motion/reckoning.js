/** Dead reckoning: steps and heading put together, a move per footstep: elfslam.stages.motion.reckoning. */

/** @typedef {import("./types.js").MotionParameters} MotionParameters */

/**
 * A move to the next footstep goes where the walker heads halfway through it.
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

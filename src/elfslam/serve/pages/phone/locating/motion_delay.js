/** Motion, held back until it is known how long sound takes, and then moved beside the sound. Pure. */

/** Without a chirp by then, motion is timed as if sound took no time. */
const PATIENCE_S = 3;

/**
 * @typedef {{tS: number, acceleration: number[] | null, turning: number[] | null}} Reading tS: of the
 *   sound that was being played
 */

/**
 * @param {{push: (tS: number, acceleration: number[], turning: number[]) => void}} footsteps
 * @param {() => number | null} latenessS
 * @returns {{push: (readings: Reading[]) => void}}
 */
export function delayMotion(footsteps, latenessS) {
  /** @type {Reading[]} */
  let waiting = [];
  let lastS = -Infinity;
  const pass = (/** @type {number} */ lateS) => {
    for (const { tS, acceleration, turning } of waiting) {
      if (!acceleration || !turning || tS + lateS <= lastS) continue;
      lastS = tS + lateS;
      footsteps.push(lastS, acceleration, turning);
    }
    waiting = [];
  };
  const push = (/** @type {Reading[]} */ readings) => {
    waiting.push(...readings);
    const lateS = latenessS();
    const isTooLong = waiting.length > 0 && waiting[waiting.length - 1].tS - waiting[0].tS > PATIENCE_S;
    if (lateS !== null || isTooLong) pass(lateS ?? 0);
  };
  return { push };
}

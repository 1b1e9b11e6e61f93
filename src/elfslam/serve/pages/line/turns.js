/**
 * Who chirps when, by the rules of elfslam.line.medium_access: slots in rounds, kept where nobody else is heard
 * and given up where one is. What was heard in a slot some rounds ago tells who will chirp in it, however
 * late a phone hears. All functions are pure; chance is given to them.
 */

/**
 * The parameters of elfslam.line.medium_access, by their names there.
 * @typedef {{jitter_s: number, softer_db: number, slots: number, listen: number, forget: number, check: number,
 *   check_least: number, check_alone: number, free_after: number, claim: number, keep: number, challenge: number, stir: number,
 *   follow: number, contrast: number, share: number, frames: number}} TurnsParameters
 * Whose turn it is, by slot of the round: whether it is ours; rounds since another phone was heard in it;
 * how often we kept silent in it, as it is ours, and heard nobody. alone: slots since another was heard.
 * @typedef {{mine: boolean[], quiet: number[], sure: number[], alone: number, shiftS: number}} Turns
 */

/** @type {TurnsParameters} as long as no map brings its own */
export const TURNS = {
  jitter_s: 0.025, softer_db: 4, slots: 8, listen: 8, forget: 100, check: 0.3, check_least: 0.08, check_alone: 0.05,
  free_after: 2,
  claim: 0.5, keep: 0.5, challenge: 0.05, stir: 0.01, follow: 0.05, contrast: 3, share: 0.006, frames: 2,
};

/** Where everybody begins: listening. @param {TurnsParameters} parameters @returns {Turns} */
export function noTurns({ slots, forget, listen }) {
  const nothing = Array(slots).fill(0);
  return { mine: Array(slots).fill(false), quiet: nothing, sure: nothing, alone: forget - listen, shiftS: 0 };
}

/**
 * Whether to chirp in a slot, counted from the beginning.
 * @param {Turns} turns @param {number} slot @param {number} draw uniform in [0, 1)
 * @param {TurnsParameters} parameters
 */
export function isPlayed(turns, slot, draw, parameters) {
  if (turns.alone >= parameters.forget) return draw >= parameters.check_alone;
  const k = slot % parameters.slots;
  const silent = Math.max(parameters.check / (1 + turns.sure[k]), parameters.check_least);
  return turns.mine[k] && draw >= silent;
}

/**
 * What is known once a slot has been heard.
 * @param {Turns} turns @param {number} slot
 * @param {number[]} othersS others' chirps in it, from the middle of where the own would be played
 * @param {boolean} isPlayedIn whether there was an own one
 * @param {number} draw uniform in [0, 1)
 * @param {TurnsParameters} parameters
 * @returns {Turns}
 */
export function afterSlot(turns, slot, othersS, isPlayedIn, draw, parameters) {
  const k = slot % parameters.slots;
  const met = othersS.length > 0;
  const now = {
    ...turns,
    quiet: turns.quiet.with(k, met ? 0 : turns.quiet[k] + 1),
    alone: met ? 0 : turns.alone + 1,
    shiftS: turns.shiftS + parameters.follow * othersS.reduce((sum, each) => sum + each, 0),
  };
  if (now.alone >= parameters.forget) {
    return { ...now, mine: turns.mine.map(() => true), sure: turns.sure.map(() => 0) };
  }
  const kept = isKept(now, k, draw, parameters);
  const isQuiet = kept && !met;
  const isChecked = turns.mine[k] && isQuiet && !isPlayedIn;
  const sure = isQuiet ? turns.sure[k] + (isChecked ? 1 : 0) : 0;
  return { ...now, mine: turns.mine.with(k, kept), sure: turns.sure.with(k, sure) };
}

/**
 * Whether a slot that was just heard is ours from now on.
 * @param {Turns} turns @param {number} k @param {number} draw @param {TurnsParameters} parameters
 */
function isKept(turns, k, draw, parameters) {
  const own = turns.mine.filter(Boolean).length;
  if (turns.mine[k]) {
    if (turns.quiet[k] === 0) return draw >= own / (own + parameters.keep);
    return draw >= (parameters.stir * own) / parameters.slots;
  }
  if (turns.quiet[k] >= parameters.free_after) return draw < parameters.claim / (1 + own);
  return own === 0 && draw < parameters.challenge;
}

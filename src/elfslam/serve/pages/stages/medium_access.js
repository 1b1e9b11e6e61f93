/**
 * Who chirps when, by the rules of elfslam.stages.medium_access: slots in rounds, kept where nobody else is heard
 * and given up where one is. What was heard in a slot some rounds ago tells who will chirp in it, however
 * late a phone hears. All functions are pure; chance is given to them.
 */

/**
 * The parameters of elfslam.stages.medium_access, by their names there.
 * @typedef {{jitter_s: number, softer_db: number, slots: number, listen: number, forget: number, check: number,
 *   check_least: number, check_alone: number, free_after: number, claim: number, keep: number, challenge: number,
 *   stir: number, follow: number, contrast: number, share: number, frames: number}} MediumAccessParameters
 * Whose turn it is, by slot of the round: whether it is ours; rounds since another phone was heard in it;
 * how often we kept silent in it, as it is ours, and heard nobody. alone: slots since another was heard.
 * @typedef {{mine: boolean[], quiet: number[], sure: number[], alone: number, shiftS: number}} SlotSchedule
 */

/** Where everybody begins: listening. @param {MediumAccessParameters} parameters @returns {SlotSchedule} */
export function initialSchedule({ slots, forget, listen }) {
  const nothing = Array(slots).fill(0);
  return { mine: Array(slots).fill(false), quiet: nothing, sure: nothing, alone: forget - listen, shiftS: 0 };
}

/**
 * Whether to chirp in a slot, counted from the beginning.
 * @param {SlotSchedule} schedule @param {number} slot @param {number} draw uniform in [0, 1)
 * @param {MediumAccessParameters} parameters
 */
export function isPlayed(schedule, slot, draw, parameters) {
  if (schedule.alone >= parameters.forget) return draw >= parameters.check_alone;
  const k = slot % parameters.slots;
  const silent = Math.max(parameters.check / (1 + schedule.sure[k]), parameters.check_least);
  return schedule.mine[k] && draw >= silent;
}

/**
 * What is known once a slot has been heard.
 * @param {SlotSchedule} schedule @param {number} slot
 * @param {number[]} othersS others' chirps in it, from the middle of where the own would be played
 * @param {boolean} isPlayedIn whether there was an own one
 * @param {number} draw uniform in [0, 1)
 * @param {MediumAccessParameters} parameters
 * @returns {SlotSchedule}
 */
export function afterSlot(schedule, slot, othersS, isPlayedIn, draw, parameters) {
  const k = slot % parameters.slots;
  const met = othersS.length > 0;
  const now = {
    ...schedule,
    quiet: schedule.quiet.with(k, met ? 0 : schedule.quiet[k] + 1),
    alone: met ? 0 : schedule.alone + 1,
    shiftS: schedule.shiftS + parameters.follow * othersS.reduce((sum, each) => sum + each, 0),
  };
  if (now.alone >= parameters.forget) {
    return { ...now, mine: schedule.mine.map(() => true), sure: schedule.sure.map(() => 0) };
  }
  const kept = isKept(now, k, draw, parameters);
  const isQuiet = kept && !met;
  const isChecked = schedule.mine[k] && isQuiet && !isPlayedIn;
  const sure = isQuiet ? schedule.sure[k] + (isChecked ? 1 : 0) : 0;
  return { ...now, mine: schedule.mine.with(k, kept), sure: schedule.sure.with(k, sure) };
}

/**
 * Whether a slot that was just heard is ours from now on.
 * @param {SlotSchedule} schedule @param {number} k @param {number} draw @param {MediumAccessParameters} parameters
 */
function isKept(schedule, k, draw, parameters) {
  const own = schedule.mine.filter(Boolean).length;
  if (schedule.mine[k]) {
    if (schedule.quiet[k] === 0) return draw >= own / (own + parameters.keep);
    return draw >= (parameters.stir * own) / parameters.slots;
  }
  if (schedule.quiet[k] >= parameters.free_after) return draw < parameters.claim / (1 + own);
  return own === 0 && draw < parameters.challenge;
}

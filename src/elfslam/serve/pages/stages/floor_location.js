/**
 * On which floor of a building a walker is, by echoes: the vote of elfslam.slam.floor_location without a barometer. It
 * is by the sound before and after a moment, so live it is told half a span later, and of the first moments not at all.
 */

import { FLOOR_VOTE } from "./constants.js";
import { greatest, similarity } from "./locate.js";

/**
 * @typedef {import("./floor_map.js").FloorMap} FloorMap
 * @typedef {{level: number | undefined, floorMap: FloorMap}} Floor level: undefined outside of buildings
 * @typedef {{tS: number, best: number[]}} Vote best: similarity of each floor's most similar spot; NaN in silence
 * @typedef {{floorMap: FloorMap, scores: Float32Array | null, level: number | null | undefined}} Heard the floor that the
 *   walker is followed on, the similarity of its spots, and its level where that is known
 * @typedef {ReturnType<typeof makeFloors>} Floors
 */

/**
 * The floor, by its place in the votes, that they elect within half a span of `atS`, and whether it leads clearly.
 * @param {Vote[]} votes @param {number} atS @param {{vote_s: number, least_lead: number}} [parameters]
 * @returns {{floor: number, isSure: boolean}}
 */
export function elected(votes, atS, { vote_s, least_lead } = FLOOR_VOTE) {
  const around = votes.filter(({ tS }) => tS >= atS - vote_s / 2 && tS <= atS + vote_s / 2);
  const said = around.filter(({ best }) => Number.isFinite(best[0]));
  const means = votes[0].best.map((_, k) => said.reduce((sum, { best }) => sum + best[k], 0) / Math.max(said.length, 1));
  const [first, second = -Infinity] = [...means].sort((a, b) => b - a);
  return { floor: greatest(means), isSure: first - second >= least_lead };
}

/**
 * The floors of a building, or one map alone.
 * @param {Floor} first that is open
 */
export function makeFloors(first) {
  const maps = new Map([[first.level, first.floorMap]]);
  let here = first.level;
  /** Whether it is known: outside of buildings, by the walker's word, or by the vote. */
  let isKnown = here === undefined;
  let isVoting = false;
  /** @type {Vote[]} */
  let votes = [];
  let begunS = Infinity;
  let isSaid = false;

  /** @param {boolean} isSaidNow by the walker */
  const beginAnew = (isSaidNow) => {
    isKnown = isSaid = isSaidNow;
    votes = [];
    begunS = Infinity;
  };

  /** @param {number} tS @param {(Float32Array | null)[]} scores of each floor */
  const vote = (tS, scores) => {
    const best = scores.map((each) => (each ? each[greatest(each)] : NaN));
    votes = [...votes.filter((each) => each.tS >= tS - FLOOR_VOTE.vote_s), { tS, best }];
    begunS = Math.min(begunS, tS);
    const atS = tS - FLOOR_VOTE.vote_s / 2;
    if (atS < begunS) return;
    const { floor, isSure } = elected(votes, atS);
    if (isSure) [here, isSaid] = [[...maps.keys()][floor], false];
    isKnown = isSure || isSaid;
  };

  return {
    /** The others have come, and the vote begins; what another encoder made cannot be compared. @param {Floor[]} others */
    join(others) {
      const comparable = others.filter(({ floorMap }) => floorMap.encoder === first.floorMap.encoder);
      for (const each of comparable) maps.set(each.level, each.floorMap);
      isVoting = true;
      beginAnew(isSaid);
    },
    /**
     * The walker says that they are on this floor, or between floors (null): until a vote decides, that holds.
     * @param {Floor | null} floor
     */
    say(floor) {
      if (floor) maps.set(floor.level, floor.floorMap);
      if (floor) here = floor.level;
      beginAnew(floor !== null);
    },
    /** What was heard until `tS`, null for silence. @param {number} tS @param {Float32Array | null} mean @returns {Heard} */
    hear(tS, mean) {
      const scores = new Map([...maps].map(([each, floorMap]) => [each, mean && similarity(mean, floorMap)]));
      if (isVoting) vote(tS, [...scores.values()]);
      const floorMap = /** @type {FloorMap} */ (maps.get(here));
      return { floorMap, scores: scores.get(here) ?? null, level: isKnown ? here : null };
    },
  };
}

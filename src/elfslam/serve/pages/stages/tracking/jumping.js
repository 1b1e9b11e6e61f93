/** Whether a walker is heard where no step can have led. */

import { densest } from "./cloud.js";

/**
 * How far from the best place guesses may reach: twice as far as half of them, and a little.
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
 * How much more alike some place is than all within reach of the guesses.
 * @param {import("./cloud.js").Cloud} cloud guesses in the middle of the step
 * @param {import("./fix.js").Spots} floorMap @param {Float32Array} scores @param {number} nearM
 * @returns {number}
 */
export function furtherLikeness(cloud, { xyM }, scores, nearM) {
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

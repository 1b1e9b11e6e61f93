/**
 * Loop closures of a walk that goes on, footstep by footstep: the sequence matching of elfslam.stages.closure, of which
 * a row is done as soon as the footsteps behind it are known. What is found is offered to the graph, which decides.
 */

const AGAIN = 1;
const BACK = -1;

/**
 * @typedef {{threshold: number, back_margin: number, near_footsteps: number, half_sequence: number, half_peak: number,
 *   ridge_footsteps: number, rival_margin: number, along_sigma_m: number, across_sigma_m: number,
 *   heading_sigma_rad: number}} ClosureParameters the group "closure", as far as pages need it
 * @typedef {{i: number, j: number, score: number, ahead: number, isBack: boolean}} Found footstep j is where footstep
 *   i < j was, `ahead` steps further, and walked the other way where `isBack`
 */

/**
 * @param {ClosureParameters} parameters
 * @returns {(mean: Float32Array | null) => Found[]} takes what was heard from a footstep to the next (unit vectors
 *   averaged; null where it was silent) and gives the earlier footsteps that sound like the one half a sequence ago,
 *   the most alike first
 */
export function makeClosureSearch(parameters) {
  const { half_sequence: half, near_footsteps: near } = parameters;
  /** @type {(Float32Array | null)[]} */
  const means = [];
  /** Of each footstep with all before it, and with itself. @type {Float32Array[]} */
  const alike = [];

  /** @param {number} j @param {number} i */
  const likeness = (j, i) => (i <= j ? alike[j][i] : alike[i][j]);

  /**
   * Averaged along the diagonal through footsteps j and i, or along the antidiagonal.
   * @param {number} j @param {number} i @param {number} reach @param {number} way
   */
  const averaged = (j, i, reach, way) => {
    let [sum, count] = [0, 0];
    for (let k = -reach; k <= reach; k += 1) {
      const [row, column] = [j + k, i + k * way];
      if (row < 0 || row >= means.length || column < 0 || column >= means.length) continue;
      sum += likeness(row, column);
      count += 1;
    }
    return sum / count;
  };

  /** @param {number} j @param {number} way @returns {Found[]} */
  const ridges = (j, way) => {
    const { ridge_footsteps: ridge, half_peak: peak } = parameters;
    const least = parameters.threshold + (way === BACK ? parameters.back_margin : 0);
    const row = Array.from({ length: j - near + 1 + ridge }, (_, i) => averaged(j, i, half, way));
    /** @param {number} i */
    const isRidge = (i) => row[i] >= Math.max(...row.slice(Math.max(i - ridge, 0), i + ridge + 1));
    const found = [];
    for (let i = half; i <= j - near; i += 1) {
      if (row[i] < least || !isRidge(i)) continue;
      const beside = offsetOf([i - 1, i, i + 1].map((each) => averaged(j, each, peak, way)));
      found.push({ i, j, score: row[i], ahead: beside + (way === BACK ? 1 : 0), isBack: way === BACK });
    }
    return found;
  };

  return (mean) => {
    means.push(mean);
    alike.push(Float32Array.from(means, (other) => (mean && other ? dot(mean, other) : 0)));
    const j = means.length - 1 - half;
    if (j - near < half) return [];
    return [...ridges(j, AGAIN), ...ridges(j, BACK)].sort((one, other) => other.score - one.score);
  };
}

/**
 * What the graph is offered: the best, unless another place is nearly as much alike.
 * @param {Found[]} found the best first @param {Float64Array} poses (3n) of the footsteps as they are now
 * @param {ClosureParameters} parameters
 * @returns {import("./growing_graph.js").Closure | null}
 */
export function unrivalled(found, poses, parameters) {
  if (found.length === 0) return null;
  const [{ i, j, score, ahead, isBack }, ...others] = found;
  /** @param {number} k @param {number} l */
  const apartM = (k, l) => Math.hypot(poses[3 * k] - poses[3 * l], poses[3 * k + 1] - poses[3 * l + 1]);
  const slackM = 3 * Math.hypot(parameters.along_sigma_m, parameters.across_sigma_m);
  if (others.some((other) => score - other.score < parameters.rival_margin && apartM(i, other.i) > slackM)) return null;
  const sigma = [parameters.along_sigma_m, parameters.across_sigma_m, parameters.heading_sigma_rad];
  return { i, j, iFromJ: [ahead * apartM(i, i + 1), 0, isBack ? Math.PI : 0], sigma };
}

/** How far beside the middle the parabola through three values peaks. @param {number[]} values */
function offsetOf([left, middle, right]) {
  const curvature = Math.min(2 * (left - 2 * middle + right), -1e-3);
  return Math.min(Math.max((left - right) / curvature, -1), 1);
}

/** @param {Float32Array} one @param {Float32Array} other */
function dot(one, other) {
  let sum = 0;
  for (let k = 0; k < one.length; k += 1) sum += one[k] * other[k];
  return sum;
}

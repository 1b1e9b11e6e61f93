/**
 * The map of a walk as far as it has come: dead reckoning, straightened by the loops that have closed and by the
 * places that the walker has marked. The server makes the map itself, anew and with more care. Pure.
 */

import { ATTENUATION } from "../../stages/constants.js";
import { wrapAngle } from "../../stages/motion/filters.js";
import { stepsUntil } from "../locating/deciding.js";

/** Where a walk was interrupted nobody knows where the walker went meanwhile. */
const UNKNOWN = { moveM: [0, 0, 0], sigma: [5, 5, 1.5] };
/** Whoever says "here again" stands there within an arm's length, facing anywhere. */
const MARK_SIGMA = [0.4, 0.4, 6];
/** Closures next to each other say the same: one in so many footsteps is enough, and fewer the longer the walk. */
const APART = 3;
const TWICE_AS_FAR_EVERY = 15;
/** So many are solved for at once on a phone. */
const MOST_CLOSURES = 60;
/** This near a closure a footstep is confirmed. */
const CONFIRMED = 15;
/** A shorter stretch is not worth walking again. */
const WORTH = 12;

/**
 * @typedef {{name: string, at: number}} Mark `at`: number of the footstep
 * @typedef {{poses: Float64Array, loops: [number, number][], marks: Mark[], gaps: number[],
 *   next: [number, number] | null}} Sketch poses: x m, y m, heading rad of each footstep; loops: footsteps at one
 *   place; gaps: footsteps before which the walk was interrupted; next: the first and the last footstep of the
 *   stretch to walk again
 * @typedef {import("../../stages/motion/filters.js").Step} Step
 */

/**
 * @param {ClosureParameters} closure parameters
 * @param {number | null} [echoDb] echoes and noise over noise, where it was measured
 */
export function makeSketch(closure, echoDb = null) {
  const graph = makeGrowingGraph();
  const search = makeClosureSearch();
  const attenuation = makeAttenuation(echoDb);
  /** @type {Mark[]} */
  let marks = [];
  /** @type {{name: string, tS: number}[]} */
  let waiting = [];
  /** @type {number[]} */
  const gaps = [];
  /** Footstep at which the last closure was believed. */
  let last = -APART;
  let count = 0;

  /** @param {Closure} found */
  const close = (found) => {
    if (graph.closures().length < MOST_CLOSURES && graph.offer(found)) last = found.j;
  };

  /** @param {Float32Array | null} mean what was heard from the footstep before to this one @param {number[]} alike */
  const listen = (mean, alike) => {
    const wanted = amidNoise(closure, attenuation(alike));
    const found = unrivalled(search(mean, wanted), graph.poses(), wanted);
    const apart = APART * 2 ** Math.floor(graph.closures().length / TWICE_AS_FAR_EVERY);
    if (found && found.j - last >= apart) close(found);
  };

  /** @param {string} name */
  const mark = (name) => {
    const known = marks.find((each) => each.name === name);
    marks = [...marks, { name, at: count }];
    if (known && count > known.at) graph.offer({ i: known.at, j: count, iFromJ: [0, 0, 0], sigma: MARK_SIGMA });
  };

  /** @param {Step} step @param {Float32Array | null} mean @param {number[]} [alike] cosines of its successive echoes */
  const step = ({ tS, moveM, sigma }, mean, alike = []) => {
    graph.step({ moveM, sigma });
    count += 1;
    listen(mean, alike);
    waiting.filter((each) => each.tS <= tS).forEach(({ name }) => mark(name));
    waiting = waiting.filter((each) => each.tS > tS);
  };

  /** The walk goes on after an interruption. */
  const gap = () => {
    if (count === 0) return;
    graph.step(UNKNOWN);
    count += 1;
    search(null, closure);
    gaps.push(count);
  };

  /** @returns {Sketch} */
  const now = () => {
    const loops = graph.closures().map(({ i, j }) => /** @type {[number, number]} */ ([i, j]));
    return { poses: graph.poses(), loops, marks, gaps, next: nextStretch(count, loops) };
  };

  return {
    step, gap, now,
    /** The walker says that this is a place, or that they are there again. @param {string} name @param {number} tS */
    mark: (name, tS) => waiting.push({ name, tS }),
  };
}

/** How much of a walk is confirmed: near a footstep at which a loop closed. @param {number} count of footsteps
 * @param {[number, number][]} loops */
export function confirmedShare(count, loops) {
  const confirmed = new Set(loops.flat().flatMap((end) =>
    Array.from({ length: 2 * CONFIRMED + 1 }, (_, k) => end - CONFIRMED + k).filter((each) => each >= 0 && each < count)));
  return confirmed.size / Math.max(count, 1);
}

/**
 * The longest stretch that no loop confirms: walked again, it would do the map most good. Null as long as every
 * stretch is short.
 * @param {number} count of footsteps, the start among them not @param {[number, number][]} loops
 * @returns {[number, number] | null}
 */
export function nextStretch(count, loops) {
  const ends = [...new Set(loops.flat())].sort((one, other) => one - other);
  if (ends.length === 0) return null; // the way back to the start closes the first
  const bounds = [-CONFIRMED, ...ends, count + CONFIRMED];
  const stretches = bounds.slice(1).map((end, k) => [bounds[k] + CONFIRMED, end - CONFIRMED]);
  const [from, to] = stretches.reduce((best, each) => (each[1] - each[0] > best[1] - best[0] ? each : best));
  return to - from < WORTH ? null : [from, to];
}

/**
 * As `decide` of a walker on a map, with a sketch in place of fixes.
 * @param {{sketch: ReturnType<typeof makeSketch>, memory: ReturnType<typeof import("../../stages/pipeline.js").makeMemory>,
 *   footsteps: {take: (nowS: number) => Step[]}}} given
 * @returns {{decide: (untilS: number) => Sketch[]}} one where footsteps have come, else none
 */
export function drawBySteps({ sketch, memory, footsteps }) {
  const ready = stepsUntil(footsteps);
  return {
    decide(untilS) {
      const steps = ready(untilS);
      for (const step of steps) {
        sketch.step(step, memory.mean(step.fromS, step.tS), memory.alike(step.fromS, step.tS));
        memory.forget(step.tS);
      }
      return steps.length > 0 ? [sketch.now()] : [];
    },
  };
}

/**
 * The pose graph of a walk that goes on, in its dual form: the unknowns are the errors of the steps, and what
 * is solved for is as small as the closures are few. The answer is that of elfslam.stages.graph for the same
 * steps and closures. A closure is believed where it fits what the graph predicts there (gating of innovations).
 */

/** Relinearised so often: the closures that are believed have passed a gate, and lie near. */
const ROUNDS = 4;
/** A chi-square of three degrees of freedom is larger in one of 100 cases. */
const GATE = 11.345;

/**
 * @typedef {{i: number, j: number, iFromJ: number[], sigma: number[]}} Closure the pose of footstep j as seen
 *   from footstep i < j (forward m, left m, turn rad), and the sigma of each
 * @typedef {{moveM: number[], sigma: number[]}} Move of a step
 */

/**
 * @param {{startPose?: number[], gate?: number}} given gate: the squared Mahalanobis distance beyond which a closure
 *   is not believed
 * @returns {{step: (move: Move) => void, offer: (closure: Closure) => boolean, poses: () => Float64Array,
 *   closures: () => Closure[]}} offer: whether the closure is believed; poses: x m, y m, heading rad of the
 *   start and of each footstep
 */
export function makeGrowingGraph({ startPose = [0, 0, 0], gate = GATE } = {}) {
  /** @type {Move[]} */
  const moves = [];
  /** @type {Closure[]} */
  let believed = [];
  /** Errors of the steps (3n). @type {number[]} */
  let errors = [];
  let poses = Float64Array.from(startPose);

  /** @param {Move} move */
  const step = (move) => {
    moves.push(move);
    errors.push(0, 0, 0);
    poses = chained(startPose, moves, errors);
  };

  const variances = () => moves.flatMap(({ sigma }) => sigma.map((each) => each * each));

  /** @param {Closure} closure */
  const offer = (closure) => {
    const rows = linearised([closure, ...believed], poses, moves);
    if (distanceOf(rows, covarianceOf(rows, variances()), errors) > gate) return false;
    believed = [...believed, closure];
    solve();
    return true;
  };

  const solve = () => {
    const prior = variances();
    for (let round = 0; round < ROUNDS; round += 1) {
      const rows = linearised(believed, poses, moves);
      const weights = solved(covarianceOf(rows, prior), innovations(rows, errors));
      errors = prior.map(() => 0);
      rows.forEach(({ of, from, to }, k) => {
        for (let at = from; at < to; at += 1) errors[at] += prior[at] * of[at] * weights[k];
      });
      poses = chained(startPose, moves, errors);
    }
  };

  return { step, offer, poses: () => poses, closures: () => believed };
}

/** Poses (3 (n+1)) by moves and their errors. @param {number[]} start @param {Move[]} moves
 * @param {number[]} errors */
function chained(start, moves, errors) {
  const poses = new Float64Array(3 * (moves.length + 1));
  let [x, y, heading] = start;
  poses.set([x, y, heading]);
  moves.forEach(({ moveM: [forward, left, turn] }, k) => {
    const [ahead, aside] = [forward + errors[3 * k], left + errors[3 * k + 1]];
    const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
    x += cos * ahead - sin * aside;
    y += sin * ahead + cos * aside;
    heading = wrapAngle(heading + turn + errors[3 * k + 2]);
    poses.set([x, y, heading], 3 * (k + 1));
  });
  return poses;
}

/**
 * One equation: what an error of each step does to a residual; those on the way from i to j alone do anything.
 * @typedef {{of: Float64Array, from: number, to: number, residual: number, variance: number}} Row
 */

/** Three equations for each closure. @param {Closure[]} closures @param {Float64Array} poses @param {Move[]} moves
 * @returns {Row[]} */
function linearised(closures, poses, moves) {
  return closures.flatMap(({ i, j, iFromJ, sigma }) => {
    const [xi, yi, hi] = poses.subarray(3 * i, 3 * i + 3);
    const [xj, yj, hj] = poses.subarray(3 * j, 3 * j + 3);
    const [cos, sin] = [Math.cos(hi), Math.sin(hi)];
    /** In the axes of footstep i. @param {number} x @param {number} y @returns {[number, number]} */
    const seen = (x, y) => [cos * x + sin * y, cos * y - sin * x];
    const [forward, left] = seen(xj - xi, yj - yi);
    const residual = [forward - iFromJ[0], left - iFromJ[1], wrapAngle(hj - hi - iFromJ[2])];
    const size = 3 * moves.length;
    const rows = [0, 1, 2].map((axis) => ({
      of: new Float64Array(size), from: 3 * i, to: 3 * j, residual: residual[axis], variance: sigma[axis] ** 2,
    }));
    /** @param {number} at @param {[number, number]} moved @param {number} turned */
    const put = (at, [dx, dy], turned) => {
      rows[0].of[at] = dx;
      rows[1].of[at] = dy;
      rows[2].of[at] = turned;
    };
    for (let k = i; k < j; k += 1) {
      const heading = poses[3 * k + 2];
      put(3 * k, seen(Math.cos(heading), Math.sin(heading)), 0);
      put(3 * k + 1, seen(-Math.sin(heading), Math.cos(heading)), 0);
      put(3 * k + 2, seen(poses[3 * k + 4] - yj, xj - poses[3 * k + 3]), 1);
    }
    return rows;
  });
}

/** Covariance of the residuals as dead reckoning predicts it, and of what was measured: a symmetric matrix.
 * @param {Row[]} rows @param {number[]} prior @returns {Float64Array[]} */
function covarianceOf(rows, prior) {
  const weighed = rows.map(({ of }) => of.map((each, at) => each * prior[at]));
  return rows.map((row, k) =>
    Float64Array.from(rows, (other, l) => {
      if (l > k) return 0; // the lower half is enough
      const [from, to] = [Math.max(row.from, other.from), Math.min(row.to, other.to)];
      return dot(weighed[k], other.of, from, to) + (k === l ? row.variance : 0);
    }));
}

/**
 * Squared Mahalanobis distance of the first three residuals from what the others predict for them.
 * @param {Row[]} rows @param {Float64Array[]} covariance @param {number[]} errors as they are now
 */
function distanceOf(rows, covariance, errors) {
  const whole = innovations(rows, errors);
  const others = covariance.slice(3).map((row) => row.subarray(3));
  return chiSquare(covariance, whole) - chiSquare(others, whole.slice(3));
}

/** What was measured less what dead reckoning alone would have. @param {Row[]} rows @param {number[]} errors */
function innovations(rows, errors) {
  return rows.map(({ of, from, to, residual }) => dot(of, errors, from, to) - residual);
}

/** @param {Float64Array[]} covariance @param {number[]} residual */
function chiSquare(covariance, residual) {
  return solved(covariance, residual).reduce((sum, each, k) => sum + each * residual[k], 0);
}

/**
 * Cholesky: x of A x = b, with A (n, n) positive definite, of which the lower half is read.
 * @param {Float64Array[]} matrix @param {number[]} right
 */
export function solved(matrix, right) {
  const lower = matrix.map((row) => row.slice());
  lower.forEach((row, k) => {
    for (let l = 0; l <= k; l += 1) {
      const rest = row[l] - dot(row, lower[l], 0, l);
      row[l] = l === k ? Math.sqrt(rest) : rest / lower[l][l];
    }
  });
  const out = [...right];
  for (let k = 0; k < out.length; k += 1) out[k] = (out[k] - dot(lower[k], out, 0, k)) / lower[k][k];
  for (let k = out.length - 1; k >= 0; k -= 1) {
    for (let l = k + 1; l < out.length; l += 1) out[k] -= lower[l][k] * out[l];
    out[k] /= lower[k][k];
  }
  return out;
}

/** @param {ArrayLike<number>} one @param {ArrayLike<number>} other @param {number} [from] @param {number} [to] */
function dot(one, other, from = 0, to = one.length) {
  let sum = 0;
  for (let k = from; k < to; k += 1) sum += one[k] * other[k];
  return sum;
}

// Loop closures of a walk that goes on, footstep by footstep: the sequence matching of elfslam.stages.closure, of which
// a row is done as soon as the footsteps behind it are known. What is found is offered to the graph, which decides.

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
 * By what share noise has shortened mean features so far: elfslam.stages.feature.attenuation_of, of the cosines of
 * successive echoes that have come.
 * @param {number | null} echoDb echoes and noise over noise, where it was measured
 * @returns {(alike: number[]) => number} takes the latest of those cosines
 */
export function makeAttenuation(echoDb) {
  const { QUIET_PHONE_DB, SUCCESSIVE, NO_RELIABILITY, LEAST_RELIABILITY } = ATTENUATION;
  const isNoisy = echoDb !== null && 10 ** (echoDb / 10) - 1 < 10 ** (QUIET_PHONE_DB / 10);
  /** In order. @type {number[]} */
  const known = [];
  return (alike) => {
    for (const cosine of isNoisy ? alike : []) known.splice(orderOf(cosine, known), 0, cosine);
    if (known.length === 0) return 1;
    const middle = (known[(known.length - 1) >> 1] + known[known.length >> 1]) / 2;
    const reliability = Math.min(middle / SUCCESSIVE, 1);
    return reliability < NO_RELIABILITY ? 1 : Math.sqrt(Math.max(reliability, LEAST_RELIABILITY));
  };
}

/** How many of those in order are smaller. @param {number} value @param {number[]} ordered */
function orderOf(value, ordered) {
  let [low, high] = [0, ordered.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (ordered[middle] < value) low = middle + 1;
    else high = middle;
  }
  return low;
}

/**
 * What counts as similar where noise has shortened mean features: two of them are multiplied.
 * @param {ClosureParameters} parameters @param {number} attenuation
 * @returns {ClosureParameters}
 */
export function amidNoise(parameters, attenuation) {
  const { threshold, back_margin: back, rival_margin: rival } = parameters;
  const left = attenuation ** 2;
  return { ...parameters, threshold: left * threshold, back_margin: left * back, rival_margin: left * rival };
}

/**
 * @returns {(mean: Float32Array | null, parameters: ClosureParameters) => Found[]} takes what was heard from a footstep
 *   to the next (unit vectors averaged; null where it was silent) and gives the earlier footsteps that sound like the
 *   one half a sequence ago, the most alike first
 */
export function makeClosureSearch() {
  /** @type {(Float32Array | null)[]} */
  const means = [];
  /** Of each footstep with all before it, and with itself. @type {Float32Array[]} */
  const alike = [];

  /** @param {number} j @param {number} i */
  const similarity = (j, i) => (i <= j ? alike[j][i] : alike[i][j]);

  /**
   * Averaged along the diagonal through footsteps j and i, or along the antidiagonal.
   * @param {number} j @param {number} i @param {number} reach @param {number} way
   */
  const averaged = (j, i, reach, way) => {
    let [sum, count] = [0, 0];
    for (let k = -reach; k <= reach; k += 1) {
      const [row, column] = [j + k, i + k * way];
      if (row < 0 || row >= means.length || column < 0 || column >= means.length) continue;
      sum += similarity(row, column);
      count += 1;
    }
    return sum / count;
  };

  /** @param {number} j @param {number} way @param {ClosureParameters} parameters @returns {Found[]} */
  const ridges = (j, way, parameters) => {
    const { half_sequence: half, near_footsteps: near, ridge_footsteps: ridge, half_peak: peak } = parameters;
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

  return (mean, parameters) => {
    const { half_sequence: half, near_footsteps: near } = parameters;
    means.push(mean);
    alike.push(Float32Array.from(means, (other) => (mean && other ? dot(mean, other) : 0)));
    const j = means.length - 1 - half;
    if (j - near < half) return [];
    return [...ridges(j, AGAIN, parameters), ...ridges(j, BACK, parameters)].sort((one, other) => other.score - one.score);
  };
}

/**
 * What the graph is offered: the best, unless another place is nearly as much alike.
 * @param {Found[]} found the best first @param {Float64Array} poses (3n) of the footsteps as they are now
 * @param {ClosureParameters} parameters
 * @returns {Closure | null}
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

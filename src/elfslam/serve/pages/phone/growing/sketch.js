/**
 * The map of a walk as far as it has come: dead reckoning, straightened by the loops that have closed and by the
 * places that the walker has marked. The server makes the map itself, anew and with more care. Pure.
 */

import { makeClosureSearch, makeGrowingGraph, unrivalled } from "../../stages/growing_graph.js";
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

/** @param {import("../../stages/growing_graph.js").ClosureParameters} closure parameters */
export function makeSketch(closure) {
  const graph = makeGrowingGraph();
  const search = makeClosureSearch(closure);
  /** @type {Mark[]} */
  let marks = [];
  /** @type {{name: string, tS: number}[]} */
  let waiting = [];
  /** @type {number[]} */
  const gaps = [];
  /** Footstep at which the last closure was believed. */
  let last = -APART;
  let count = 0;

  /** @param {import("../../stages/growing_graph.js").Closure} found */
  const close = (found) => {
    if (graph.closures().length < MOST_CLOSURES && graph.offer(found)) last = found.j;
  };

  /** @param {Float32Array | null} mean what was heard from the footstep before to this one */
  const listen = (mean) => {
    const found = unrivalled(search(mean), graph.poses(), closure);
    const apart = APART * 2 ** Math.floor(graph.closures().length / TWICE_AS_FAR_EVERY);
    if (found && found.j - last >= apart) close(found);
  };

  /** @param {string} name */
  const mark = (name) => {
    const known = marks.find((each) => each.name === name);
    marks = [...marks, { name, at: count }];
    if (known && count > known.at) graph.offer({ i: known.at, j: count, iFromJ: [0, 0, 0], sigma: MARK_SIGMA });
  };

  /** @param {Step} step @param {Float32Array | null} mean */
  const step = ({ tS, moveM, sigma }, mean) => {
    graph.step({ moveM, sigma });
    count += 1;
    listen(mean);
    waiting.filter((each) => each.tS <= tS).forEach(({ name }) => mark(name));
    waiting = waiting.filter((each) => each.tS > tS);
  };

  /** The walk goes on after an interruption. */
  const gap = () => {
    if (count === 0) return;
    graph.step(UNKNOWN);
    count += 1;
    search(null);
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
        sketch.step(step, memory.mean(step.fromS, step.tS));
        memory.forget(step.tS);
      }
      return steps.length > 0 ? [sketch.now()] : [];
    },
  };
}

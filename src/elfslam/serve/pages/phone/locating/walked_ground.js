/** The ground that was walked as a graph, and the shortest way along it (Dijkstra 1959). Pure. */

import { thinned } from "./ground_of_map.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {{points: Point[], near: (xy_m: Point) => number[]}} WalkedGround places, and which of them lie in reach */
/**
 * How far it is from each place to one goal, and which place comes next on the way (-1 at its end).
 * @typedef {{goal_m: Point, ground: WalkedGround, away_m: Float64Array, next: Int32Array}} Ways
 */

const APART_M = 0.25;
/** Who walks along both sides of a wall is further away from himself than this: half a body each, and the wall. */
const REACH_M = 0.7;

/** @param {Point[]} points of all walks @returns {WalkedGround} */
export function walkedGroundOf(points) {
  const kept = thinned(points, APART_M);
  /** @type {Map<string, number[]>} */
  const cells = new Map();
  const cellOf = (/** @type {number} */ metres) => Math.floor(metres / REACH_M);
  kept.forEach(([x, y], at) => {
    const key = `${cellOf(x)},${cellOf(y)}`;
    const cell = cells.get(key);
    if (cell) cell.push(at);
    else cells.set(key, [at]);
  });
  /** @param {Point} xy_m */
  const near = (xy_m) => {
    const [column, row] = xy_m.map(cellOf);
    return [-1, 0, 1].flatMap((dx) => [-1, 0, 1].flatMap((dy) => cells.get(`${column + dx},${row + dy}`) ?? []))
      .filter((at) => between(kept[at], xy_m) <= REACH_M);
  };
  return { points: kept, near };
}

/** @param {WalkedGround} ground @param {Point} goal_m which may lie beside the ground @returns {Ways} */
export function waysTo(ground, goal_m) {
  const { points, near } = ground;
  const away_m = new Float64Array(points.length).fill(Infinity);
  const next = new Int32Array(points.length).fill(-1);
  const first = nearest(points, goal_m);
  if (first < 0) return { goal_m, ground, away_m, next };
  away_m[first] = between(points[first], goal_m);
  const waiting = [{ at: first, away_m: away_m[first] }];
  for (let here = taken(waiting); here; here = taken(waiting)) {
    if (here.away_m > away_m[here.at]) continue;
    for (const other of near(points[here.at])) {
      const far_m = here.away_m + between(points[here.at], points[other]);
      if (far_m >= away_m[other]) continue;
      away_m[other] = far_m;
      next[other] = here.at;
      put(waiting, { at: other, away_m: far_m });
    }
  }
  return { goal_m, ground, away_m, next };
}

/** The way from a place to the goal; null where no walk leads there. @param {Ways} ways @param {Point} from_m
 * @returns {{length_m: number, line: Point[]} | null} */
export function wayFrom({ goal_m, ground: { points }, away_m, next }, from_m) {
  const first = nearest(points, from_m);
  if (first < 0 || away_m[first] === Infinity) return null;
  const straight_m = between(from_m, goal_m);
  if (straight_m <= REACH_M) return { length_m: straight_m, line: [from_m, goal_m] };
  const line = [from_m];
  for (let at = first; at >= 0; at = next[at]) line.push(points[at]);
  return { length_m: between(from_m, points[first]) + away_m[first], line: [...line, goal_m] };
}

/** The point so far along a line, or its end. @param {Point[]} line @param {number} far_m @returns {Point} */
export function pointAlong(line, far_m) {
  let left_m = far_m;
  for (let k = 1; k < line.length; k += 1) {
    const step_m = between(line[k - 1], line[k]);
    if (step_m >= left_m && step_m > 0) {
      const share = left_m / step_m;
      return [line[k - 1][0] + share * (line[k][0] - line[k - 1][0]), line[k - 1][1] + share * (line[k][1] - line[k - 1][1])];
    }
    left_m -= step_m;
  }
  return line[line.length - 1];
}

/** @param {Point} one @param {Point} other */
export function between([x, y], [u, v]) {
  return Math.hypot(x - u, y - v);
}

/** @param {Point[]} points @param {Point} xy_m @returns {number} -1 where there are none */
function nearest(points, xy_m) {
  let best = -1;
  let best_m = Infinity;
  points.forEach((point, at) => {
    const far_m = between(point, xy_m);
    if (far_m < best_m) [best, best_m] = [at, far_m];
  });
  return best;
}

/** Into a binary heap, the nearest first. @param {{at: number, away_m: number}[]} heap @param {{at: number, away_m: number}} item */
function put(heap, item) {
  let at = heap.push(item) - 1;
  while (at > 0) {
    const above = (at - 1) >> 1;
    if (heap[above].away_m <= heap[at].away_m) return;
    [heap[above], heap[at]] = [heap[at], heap[above]];
    at = above;
  }
}

/** The nearest, out of the heap. @param {{at: number, away_m: number}[]} heap */
function taken(heap) {
  const top = heap[0];
  const last = heap.pop();
  if (!last || heap.length === 0) return top;
  heap[0] = last;
  for (let at = 0; ; ) {
    const [left, right] = [2 * at + 1, 2 * at + 2];
    let least = at;
    if (left < heap.length && heap[left].away_m < heap[least].away_m) least = left;
    if (right < heap.length && heap[right].away_m < heap[least].away_m) least = right;
    if (least === at) return top;
    [heap[at], heap[least]] = [heap[least], heap[at]];
    at = least;
  }
}

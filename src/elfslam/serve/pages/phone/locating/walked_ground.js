/** The ground that was walked as a graph, and the shortest way along it (Dijkstra 1959). Pure. */

import { boundsOf } from "../../shared/map/projection.js";
import { t } from "../../shared/words.js";
import { mapTowards, within } from "./words.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {{points: Point[], near: (xy_m: Point) => number[]}} WalkedGround places, and which of them lie in reach */
/**
 * How far it is from each place to one goal, and which place comes next on the way (-1 at its end).
 * @typedef {{goal_m: Point, ground: WalkedGround, away_m: Float64Array, next: Int32Array}} Ways
 */

/** More spots than are worth drawing lie closer together than this. */
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

// What is drawn of a map: where it reaches, the ground that it covers, and its walks as thin lines.

/** So far around a spot the map knows its way. */
const COVER_M = 0.8;
/** Spots further apart do not follow each other on a walk. */
const NEXT_M = 0.6;

/** @typedef {{bounds_m: import("../../shared/map/projection.js").Bounds, cover: Path2D, walks: Path2D}} Ground */

/** @param {{xyM: Float32Array}} floorMap @returns {Ground} */
export function groundOf({ xyM }) {
  const points = pointsOf(xyM);
  const [x0, y0, x1, y1] = boundsOf(points) ?? [-1, -1, 1, 1];
  return {
    bounds_m: [x0 - COVER_M, y0 - COVER_M, x1 + COVER_M, y1 + COVER_M],
    cover: coverOf(thinned(points, APART_M)),
    walks: walksOf(points),
  };
}

/** @param {Float32Array} xyM @returns {[number, number][]} */
export function pointsOf(xyM) {
  return Array.from({ length: xyM.length / 2 }, (_, k) => [xyM[2 * k], xyM[2 * k + 1]]);
}

/** One point of each square of this side. @param {[number, number][]} points @param {number} sideM */
export function thinned(points, sideM) {
  const kept = new Map();
  for (const point of points) {
    const key = point.map((metres) => Math.floor(metres / sideM)).join();
    if (!kept.has(key)) kept.set(key, point);
  }
  return [...kept.values()];
}

/** Which points are joined to the one before them. @param {[number, number][]} points @returns {boolean[]} */
export function joins(points) {
  return points.map(([x, y], k) => k > 0 && Math.hypot(x - points[k - 1][0], y - points[k - 1][1]) < NEXT_M);
}

/** @param {[number, number][]} points */
function coverOf(points) {
  const path = new Path2D();
  for (const [x, y] of points) {
    path.moveTo(x + COVER_M, y);
    path.arc(x, y, COVER_M, 0, 2 * Math.PI);
  }
  return path;
}

/** @param {[number, number][]} points */
function walksOf(points) {
  const path = new Path2D();
  const joined = joins(points);
  points.forEach(([x, y], k) => (joined[k] ? path.lineTo(x, y) : path.moveTo(x, y)));
  return path;
}

// How far it is to a place and which way, in words. Pure.

/** @typedef {import("./words.js").Fix} Fix */

/** @typedef {NonNullable<ReturnType<typeof wayFrom>>} Way */

/** Who is so near sees it. */
const THERE_M = 1.5;
/** Nobody turns for the first step alone. */
const AHEAD_M = 2;

const TURNS = [
  t("straight ahead"), t("half left"), t("to the left"), t("sharp left"), t("behind you"), t("sharp right"),
  t("to the right"), t("half right"),
];

/** A way that is hardly longer than the straight line is told as one. */
const STRAIGHT = 1.15;

/**
 * The straight line is the least that it can be, the walked way leads there for sure; the shortest is between.
 * @param {string} name @param {Fix | null} fix the latest @param {Way | null} way from there; null where no walk
 * leads @param {Point} goal_m
 */
export function wayWords(name, fix, way, goal_m) {
  if (!fix?.xyM || fix.status !== "OK") return t("{{name}}: told once your place is known", { name });
  const straight_m = between(fix.xyM, goal_m);
  if ((way?.length_m ?? straight_m) <= THERE_M) return t("{{name}}: you are there", { name });
  const told = { name, distance: within(straight_m), towards: direction(fix, goal_m) };
  if (!way) return t("{{name}}: {{distance}} in a straight line, {{towards}}; nobody walked all the way", told);
  const first = direction(fix, pointAlong(way.line, AHEAD_M));
  if (way.length_m <= STRAIGHT * straight_m && first === told.towards) return t("{{name}}: {{distance}}, {{towards}}", told);
  return t("{{name}}: {{distance}}, {{towards}}; along walked ground {{along}}, first {{first}}", { ...told, along: within(way.length_m), first });
}

/** As the walker faces, or on the map where that is not known. @param {Fix} fix @param {Point} to_m */
function direction({ xyM, headingRad }, to_m) {
  const [x, y] = /** @type {Point} */ (xyM);
  const bearing_rad = Math.atan2(to_m[1] - y, to_m[0] - x);
  if (!Number.isFinite(headingRad)) return t("{{towards}} on the map", { towards: mapTowards(bearing_rad) });
  const eighth = Math.round((4 * (bearing_rad - headingRad)) / Math.PI);
  return TURNS[((eighth % 8) + 8) % 8];
}

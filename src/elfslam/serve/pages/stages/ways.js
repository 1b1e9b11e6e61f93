/**
 * Ways through a building: the shortest path in time over walked ground and passages (Dijkstra 1959, from the goal
 * backwards: who strays has another way at once). The same as `stages/ways.py`. Pure.
 */

/** @typedef {[number, number]} Point */
/** @typedef {{level: number, xy_m: Point}} LevelPosition */
/**
 * @typedef {{kind: "stairs" | "lift" | "escalator", from_level: number, to_level: number, from_xy_m: Point,
 *   to_xy_m: Point, duration_s: number}} Passage
 */
/**
 * Walked places, then from firstEnd on the two ends of each passage; into: from where one comes to a node, and how long
 * that takes.
 * @typedef {{level: number[], points: Point[], firstEnd: number, passages: Passage[],
 *   into: (at: number) => Arc[]}} WayGraph
 * @typedef {{from: number, s: number}} Arc
 */
/**
 * How long it takes from each node to one goal, and which comes next on the way (-1 at its end).
 * @typedef {{goal: LevelPosition, graph: WayGraph, last: number, away_s: Float64Array, next: Int32Array}} Ways
 * @typedef {{level: number, line: Point[], leavesBy: Passage["kind"] | null}} Leg
 * @typedef {{length_m: number, duration_s: number, legs: Leg[]}} Way
 */

/** More places than lead anywhere lie closer together than this. */
const APART_M = 0.25;
/** Who walks along both sides of a wall is further away from himself than this: half a body each, and the wall. */
const REACH_M = 0.7;
/** A passage whose end lies further from walked ground is not joined to it. */
const JOINED_M = 5;
const WALKING_MPS = 1.2;
const LIFT_WAIT_S = 30;
/** More cells than lie along any building. */
const CELLS = 2 ** 20;

/** For wheels: neither stairs nor escalators. @param {Passage[]} passages */
export function withoutSteps(passages) {
  return passages.filter(({ kind }) => kind === "lift");
}

/** @param {{level: number, points: Point[]}[]} floors what was walked on each @param {Passage[]} passages @returns {WayGraph} */
export function wayGraphOf(floors, passages) {
  const walked = floors.map(({ level, points }) => ({ level, points: thinned(points) })).filter(({ points }) => points.length > 0);
  const there = new Set(walked.map(({ level }) => level));
  const used = passages.filter(({ from_level, to_level }) => there.has(from_level) && there.has(to_level));
  const level = walked.flatMap((floor) => floor.points.map(() => floor.level));
  const points = walked.flatMap((floor) => floor.points);
  const firstEnd = points.length;
  for (const each of used) {
    level.push(each.from_level, each.to_level);
    points.push(each.from_xy_m, each.to_xy_m);
  }
  const near = neighbours(level, points);
  const links = linksOf({ level, points, firstEnd, passages: used });
  /** @param {number} at */
  const into = (at) => (links.has(at) ? [...near(at), ...(links.get(at) ?? [])] : near(at));
  return { level, points, firstEnd, passages: used, into };
}

/** @param {WayGraph} graph @param {LevelPosition} goal which may lie beside the ground @returns {Ways} */
export function waysTo(graph, goal) {
  const away_s = new Float64Array(graph.points.length).fill(Infinity);
  const next = new Int32Array(graph.points.length).fill(-1);
  const last = nearest(graph, goal);
  if (last >= 0) away_s[last] = 0;
  const waiting = last < 0 ? [] : [{ at: last, away_s: 0 }];
  for (let here = taken(waiting); here; here = taken(waiting)) {
    if (here.away_s > away_s[here.at]) continue;
    for (const { from, s } of graph.into(here.at)) {
      const far_s = here.away_s + s;
      if (far_s >= away_s[from]) continue;
      away_s[from] = far_s;
      next[from] = here.at;
      put(waiting, { at: from, away_s: far_s });
    }
  }
  return { goal, graph, last, away_s, next };
}

/** The quickest way from a place to the goal; null where no walk leads there. @param {Ways} ways
 * @param {LevelPosition} from @returns {Way | null} */
export function wayFrom({ goal, graph, last, away_s, next }, from) {
  const first = nearest(graph, from);
  if (first < 0 || away_s[first] === Infinity) return null;
  const straight_m = between(from.xy_m, goal.xy_m);
  if (from.level === goal.level && straight_m <= REACH_M) {
    const line = [from.xy_m, goal.xy_m];
    return { length_m: straight_m, duration_s: straight_m / WALKING_MPS, legs: [{ level: goal.level, line, leavesBy: null }] };
  }
  const { points, level, passages, firstEnd } = graph;
  /** @type {Leg[]} */
  const legs = [{ level: level[first], line: [from.xy_m], leavesBy: null }];
  for (let at = first; at >= 0; at = next[at]) {
    legs[legs.length - 1].line.push(points[at]);
    if (next[at] < 0 || level[next[at]] === level[at]) continue;
    legs[legs.length - 1].leavesBy = passages[(at - firstEnd) >> 1].kind;
    legs.push({ level: level[next[at]], line: [], leavesBy: null });
  }
  legs[legs.length - 1].line.push(goal.xy_m);
  const beside_m = between(from.xy_m, points[first]) + between(points[last], goal.xy_m);
  return { length_m: lengthOf(legs.flatMap(({ line }) => line)), duration_s: away_s[first] + beside_m / WALKING_MPS, legs };
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

/** @param {Point[]} line */
export function lengthOf(line) {
  return line.reduce((sum, point, k) => (k === 0 ? 0 : sum + between(line[k - 1], point)), 0);
}

/** @param {Point} one @param {Point} other */
export function between([x, y], [u, v]) {
  return Math.sqrt((x - u) ** 2 + (y - v) ** 2); // many times as fast as Math.hypot
}

/** The first point in each square. @param {Point[]} points @param {number} [sideM] */
export function thinned(points, sideM = APART_M) {
  const kept = new Map();
  for (const point of points) {
    const key = point.map((metres) => Math.floor(metres / sideM)).join();
    if (!kept.has(key)) kept.set(key, point);
  }
  return [...kept.values()];
}

/** Arcs into a node from those in reach, on its floor. @param {number[]} level @param {Point[]} points
 * @returns {(at: number) => Arc[]} */
function neighbours(level, points) {
  /** @type {Map<number, number[]>} */
  const cells = new Map();
  const cellOf = (/** @type {number} */ metres) => Math.floor(metres / REACH_M) + CELLS / 2;
  const keyOf = (/** @type {number} */ at) => (level[at] * CELLS + cellOf(points[at][0])) * CELLS + cellOf(points[at][1]);
  points.forEach((_, at) => {
    const key = keyOf(at);
    const cell = cells.get(key);
    if (cell) cell.push(at);
    else cells.set(key, [at]);
  });
  return (at) => {
    /** @type {Arc[]} */
    const arcs = [];
    const here = keyOf(at);
    for (let column = here - CELLS; column <= here + CELLS; column += CELLS) {
      for (let key = column - 1; key <= column + 1; key += 1) {
        for (const from of cells.get(key) ?? []) {
          const far_m = between(points[from], points[at]);
          if (from !== at && level[from] === level[at] && far_m <= REACH_M) arcs.push({ from, s: far_m / WALKING_MPS });
        }
      }
    }
    return arcs;
  };
}

/** Arcs into nodes through passages, of which escalators lead one way, and between their ends and walked ground beyond
 * reach. @param {Omit<WayGraph, "into">} graph @returns {Map<number, Arc[]>} */
function linksOf({ level, points, firstEnd, passages }) {
  /** @type {Map<number, Arc[]>} */
  const links = new Map();
  const join = (/** @type {number} */ from, /** @type {number} */ to, /** @type {number} */ s) => {
    links.set(to, [...(links.get(to) ?? []), { from, s }]);
  };
  const places = { level: level.slice(0, firstEnd), points: points.slice(0, firstEnd) };
  passages.forEach(({ kind, duration_s }, k) => {
    const end = firstEnd + 2 * k;
    const s = duration_s + (kind === "lift" ? LIFT_WAIT_S : 0);
    join(end, end + 1, s);
    if (kind !== "escalator") join(end + 1, end, s);
    for (const at of [end, end + 1]) {
      const place = nearest(places, { level: level[at], xy_m: points[at] });
      const far_m = between(points[place], points[at]);
      if (far_m <= REACH_M || far_m > JOINED_M) continue;
      join(at, place, far_m / WALKING_MPS);
      join(place, at, far_m / WALKING_MPS);
    }
  });
  return links;
}

/** @param {{level: number[], points: Point[]}} places @param {LevelPosition} position
 * @returns {number} -1 where nothing was walked on its floor */
function nearest({ level, points }, position) {
  let best = -1;
  let best_m = Infinity;
  points.forEach((point, at) => {
    const far_m = level[at] === position.level ? between(point, position.xy_m) : Infinity;
    if (far_m < best_m) [best, best_m] = [at, far_m];
  });
  return best;
}

/** Into a binary heap, the nearest first. @param {{at: number, away_s: number}[]} heap @param {{at: number, away_s: number}} item */
function put(heap, item) {
  let at = heap.push(item) - 1;
  while (at > 0) {
    const above = (at - 1) >> 1;
    if (heap[above].away_s <= heap[at].away_s) return;
    [heap[above], heap[at]] = [heap[at], heap[above]];
    at = above;
  }
}

/** The nearest, out of the heap. @param {{at: number, away_s: number}[]} heap */
function taken(heap) {
  const top = heap[0];
  const last = heap.pop();
  if (!last || heap.length === 0) return top;
  heap[0] = last;
  for (let at = 0; ; ) {
    const [left, right] = [2 * at + 1, 2 * at + 2];
    let least = at;
    if (left < heap.length && heap[left].away_s < heap[least].away_s) least = left;
    if (right < heap.length && heap[right].away_s < heap[least].away_s) least = right;
    if (least === at) return top;
    [heap[at], heap[least]] = [heap[least], heap[at]];
    at = least;
  }
}

// What lies nearest to a point: a grid over many points. Pure.

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {{points: Point[], cell_m: number, cells: Map<string, number[]>}} Index */

/** @param {Point[]} points @returns {Index} */
export function indexOf(points) {
  const cell_m = cellFor(points);
  /** @type {Map<string, number[]>} */
  const cells = new Map();
  points.forEach((point, at) => {
    const key = keyOf(Math.floor(point[0] / cell_m), Math.floor(point[1] / cell_m));
    const cell = cells.get(key);
    if (cell) cell.push(at);
    else cells.set(key, [at]);
  });
  return { points, cell_m, cells };
}

/** A few points to a cell. @param {Point[]} points */
function cellFor(points) {
  const xs = points.map((p) => p[0]);
  const ys = points.map((p) => p[1]);
  const range = (/** @type {number[]} */ v) => v.reduce((a, b) => Math.max(a, b), -Infinity) - v.reduce((a, b) => Math.min(a, b), Infinity);
  const area_m2 = points.length === 0 ? 1 : range(xs) * range(ys);
  return Math.max(0.05, Math.sqrt((4 * area_m2) / Math.max(points.length, 1)));
}

/** @param {number} column @param {number} row */
function keyOf(column, row) {
  return `${column},${row}`;
}

/**
 * The index of the nearest point within reach that is `allowed`; null where there is none.
 * @param {Index} index @param {Point} xy @param {number} reach_m @param {(at: number) => boolean} [allowed]
 * @returns {number | null}
 */
export function nearest({ points, cell_m, cells }, [x, y], reach_m, allowed = () => true) {
  let [best, best_m] = [/** @type {number | null} */ (null), reach_m];
  const look = (/** @type {number} */ at) => {
    const away_m = Math.hypot(points[at][0] - x, points[at][1] - y);
    if (away_m <= best_m && allowed(at)) [best, best_m] = [at, away_m];
  };
  const span = (2 * reach_m) / cell_m;
  if (span * span > cells.size) {
    points.forEach((_, at) => look(at));
    return best;
  }
  for (let column = Math.floor((x - reach_m) / cell_m); column <= (x + reach_m) / cell_m; column += 1) {
    for (let row = Math.floor((y - reach_m) / cell_m); row <= (y + reach_m) / cell_m; row += 1) {
      cells.get(keyOf(column, row))?.forEach(look);
    }
  }
  return best;
}

// The lines and squares of a map in metres, as the canvas draws them.

import { colourAt, css } from "./colours.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("./scene.js").Scene} Scene */
/** @typedef {ReturnType<typeof madeOf>} Paths */

/** How many shades time has. */
export const SHADES = 24;

/** @type {WeakMap<Scene, Paths>} */
const KEPT = new WeakMap();

/** What a map is drawn of; made once. @param {Scene} scene @returns {Paths} */
export function pathsOf(scene) {
  const kept = KEPT.get(scene) ?? madeOf(scene);
  KEPT.set(scene, kept);
  return kept;
}

/** @param {Scene} scene */
function madeOf(scene) {
  const closures = new Path2D();
  for (const [x0, y0, x1, y1] of scene.closures) {
    closures.moveTo(x0, y0);
    closures.lineTo(x1 + 1e-3, y1); // A line without length is not drawn, not even its round ends.
  }
  return {
    closures,
    walks: scene.walks.map((walk) => lineOf(walk.xy_m)),
    bands: scene.walks.map((walk) => walk.bands.map(({ points }) => lineOf(points))),
    times: scene.walks.map((walk) => timesOf(walk.t_s, walk.xy_m)),
    reckoned: scene.reckoned.map((walk) => lineOf(walk.xy_m)),
    coverage: { walks: cellsOf(scene, "walks"), sigma_m: cellsOf(scene, "sigma_m") },
  };
}

/** @param {Point[]} points */
function lineOf(points) {
  const path = new Path2D();
  points.forEach(([x, y], at) => (at === 0 ? path.moveTo(x, y) : path.lineTo(x, y)));
  if (points.length === 1) path.lineTo(points[0][0] + 1e-3, points[0][1]);
  return path;
}

/** A walk as lines of one shade of time each; by order where times are not known. @param {number[]} t_s @param {Point[]} xy_m */
function timesOf(t_s, xy_m) {
  const shades = Array.from({ length: SHADES }, () => new Path2D());
  const timed = t_s.length === xy_m.length ? t_s : xy_m.map((_, at) => at);
  const [start, duration] = [timed[0], Math.max(timed[timed.length - 1] - timed[0], 1e-9)];
  for (let at = 1; at < xy_m.length; at += 1) {
    const shade = Math.min(SHADES - 1, Math.floor((SHADES * (timed[at] - start)) / duration));
    shades[shade].moveTo(...xy_m[at - 1]);
    shades[shade].lineTo(...xy_m[at]);
  }
  return shades;
}

/** The squares as an image of a pixel each. @param {Scene} scene @param {"walks" | "sigma_m"} what */
function cellsOf({ coverage, limits }, what) {
  const between = limits[what];
  if (!coverage || !between) return null;
  const [rows, columns] = coverage.shape;
  const canvas = Object.assign(document.createElement("canvas"), { width: columns, height: rows });
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  coverage[what].forEach((row, r) => row.forEach((value, c) => {
    if (value === null || !coverage.walks[r][c]) return;
    context.fillStyle = css(coverageColour(value, between, what));
    context.fillRect(c, r, 1, 1);
  }));
  return canvas;
}

/** Yellow is good: many walks, or a small error. @param {number} value
 * @param {{low: number, high: number}} limits @param {"walks" | "sigma_m"} what */
export function coverageColour(value, { low, high }, what) {
  const share = (value - low) / (high - low);
  return colourAt("cividis", what === "walks" ? share : 1 - share);
}

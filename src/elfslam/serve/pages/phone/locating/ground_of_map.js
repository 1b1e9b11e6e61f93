/** What is drawn of a map: where it reaches, the ground that it covers, and its walks as thin lines. */

import { boundsOf } from "../../shared/map/projection.js";

/** So far around a spot the map knows its way. */
const COVER_M = 0.8;
/** Spots further apart do not follow each other on a walk. */
const NEXT_M = 0.6;
/** More spots than are worth drawing lie closer together than this. */
const APART_M = 0.25;

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

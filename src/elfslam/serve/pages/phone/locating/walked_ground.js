/** What is drawn of walked ground, and the way along it in words. Pure. */

import { boundsOf } from "../../shared/map/projection.js";
import { inSentence, t } from "../../shared/words.js";
import { between, lengthOf, pointAlong, thinned } from "../../stages/ways.js";
import { floorName, mapTowards, theFloor, within } from "./words.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */

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
    cover: coverOf(thinned(points)),
    walks: walksOf(points),
  };
}

/** @param {Float32Array} xyM @returns {[number, number][]} */
export function pointsOf(xyM) {
  return Array.from({ length: xyM.length / 2 }, (_, k) => [xyM[2 * k], xyM[2 * k + 1]]);
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

/** @typedef {import("../../stages/ways.js").Way} Way */

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
  const first = direction(fix, pointAlong(way.legs[0].line, AHEAD_M));
  if (way.length_m <= STRAIGHT * straight_m && first === told.towards) return t("{{name}}: {{distance}}, {{towards}}", told);
  return t("{{name}}: {{distance}}, {{towards}}; along walked ground {{along}}, first {{first}}", { ...told, along: within(way.length_m), first });
}

/** @type {Record<NonNullable<Way["legs"][0]["leavesBy"]>, (floor: string) => string>} */
const TAKE = {
  stairs: (floor) => t("take the stairs to {{floor}}", { floor }),
  lift: (floor) => t("take the lift to {{floor}}", { floor }),
  escalator: (floor) => t("take the escalator to {{floor}}", { floor }),
};

/**
 * Over other floors, as far as the next passage.
 * @param {string} name @param {number} level where it is @param {Fix | null} fix @param {Way | null} way
 * @param {boolean} isStepless whether stairs are avoided
 */
export function floorWayWords(name, level, fix, way, isStepless) {
  if (!fix?.xyM || fix.status !== "OK") return t("{{name}}: told once your place is known", { name });
  const told = { name, floor: inSentence(floorName(level)) };
  if (!way && isStepless) return t("{{name}}, {{floor}}: no way without stairs is known", told);
  if (!way) return t("{{name}}, {{floor}}: nobody walked all the way", told);
  const [{ line, leavesBy }, after] = way.legs;
  const far_m = lengthOf(line);
  const take = leavesBy ? TAKE[leavesBy](theFloor(after.level)) : "";
  const values = { ...told, along: within(way.length_m), take };
  if (far_m <= THERE_M) return t("{{name}}, {{floor}}: here {{take}}; {{along}} in all", values);
  const first = direction(fix, pointAlong(line, AHEAD_M));
  return t("{{name}}, {{floor}}: {{along}}; first {{first}}, after {{distance}} {{take}}", { ...values, first, distance: within(far_m) });
}

/** As the walker faces, or on the map where that is not known. @param {Fix} fix @param {Point} to_m */
function direction({ xyM, headingRad }, to_m) {
  const [x, y] = /** @type {Point} */ (xyM);
  const bearing_rad = Math.atan2(to_m[1] - y, to_m[0] - x);
  if (!Number.isFinite(headingRad)) return t("{{towards}} on the map", { towards: mapTowards(bearing_rad) });
  const eighth = Math.round((4 * (bearing_rad - headingRad)) / Math.PI);
  return TURNS[((eighth % 8) + 8) % 8];
}

// A map as the viewer needs it: walks with their lengths, paths and an index of every footstep.

import { withoutMarks } from "../../shared/format.js";
import { stretches } from "./band.js";
import { limitsOf } from "./colours.js";
import { indexOf } from "./nearest.js";
import { around, boundsOf } from "../../shared/map/projection.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("../../shared/map/projection.js").Bounds} Bounds */
/** @typedef {{name: string, t_s: number[], xy_m: Point[], sigma_m: (number | null)[]}} GivenWalk */
/**
 * @typedef {object} Given what the server tells of a map
 * @property {string} kind
 * @property {Bounds} bounds_m
 * @property {GivenWalk[]} walks
 * @property {{name: string, xy_m: Point[]}[]} dead_reckoning
 * @property {[number, number, number, number][]} closures
 * @property {null | Coverage} coverage
 */
/** @typedef {{corner_m: Point, cell_m: number, shape: [number, number], walks: (number | null)[][], sigma_m: (number | null)[][]}} Coverage */
/** @typedef {GivenWalk & {length_m: number, duration_s: number, middle_sigma_m: number | null, bands: import("./band.js").Stretch[]}} Walk */
/** @typedef {ReturnType<typeof sceneOf>} Scene */

/** @param {Given} given */
export function sceneOf(given) {
  const shown = withoutMarks(given.walks.map((walk) => walk.name));
  const named = (/** @type {{name: string}} */ { name }) => shown.get(name) ?? name;
  const walks = given.walks.map((walk) => walkOf({ ...walk, name: named(walk) }));
  const points = walks.flatMap((walk) => walk.xy_m);
  const first = firstRows(walks);
  const bounds_m = around(given.bounds_m ?? null, boundsOf(points)) ?? /** @type {Bounds} */ ([-1, -1, 1, 1]);
  return {
    kind: given.kind,
    walks,
    reckoned: given.dead_reckoning.map((walk) => ({ ...walk, name: named(walk) })),
    closures: given.closures,
    coverage: given.coverage,
    limits: {
      walks: given.coverage && limitsOf(given.coverage.walks.map((row) => row.map((count) => count || null))),
      sigma_m: given.coverage && limitsOf(given.coverage.sigma_m),
    },
    bounds_m,
    drawn_m: widened(bounds_m, medianOf(walks.map((walk) => walk.middle_sigma_m)) ?? 0),
    index: indexOf(points),
    first,
  };
}

/** With room for the band of uncertainty. @param {Bounds} bounds @param {number} sigma_m
 * @returns {Bounds} */
function widened([x0, y0, x1, y1], sigma_m) {
  const by_m = Math.min(2 * sigma_m, 0.25 * Math.max(x1 - x0, y1 - y0));
  return [x0 - by_m, y0 - by_m, x1 + by_m, y1 + by_m];
}

/** @param {GivenWalk} given @returns {Walk} */
function walkOf(given) {
  const { t_s, xy_m, sigma_m } = given;
  return {
    ...given,
    length_m: lengthOf(xy_m),
    duration_s: t_s.length > 0 ? t_s[t_s.length - 1] - t_s[0] : 0,
    middle_sigma_m: medianOf(sigma_m ?? []),
    bands: stretches(xy_m, sigma_m ?? []),
  };
}

/** The row in the index at which each walk begins. @param {Walk[]} walks */
function firstRows(walks) {
  let row = 0;
  return walks.map((walk) => {
    const here = row;
    row += walk.xy_m.length;
    return here;
  });
}

/** Which walk and footstep a row of the index is. @param {Scene} scene @param {number} row
 * @returns {{walk: number, step: number}} */
export function stepAt(scene, row) {
  let walk = scene.first.length - 1;
  while (walk > 0 && scene.first[walk] > row) walk -= 1;
  return { walk, step: row - scene.first[walk] };
}

/** @param {Point[]} xy_m @returns {number} metres along the line */
export function lengthOf(xy_m) {
  let length_m = 0;
  for (let at = 1; at < xy_m.length; at += 1) {
    length_m += Math.hypot(xy_m[at][0] - xy_m[at - 1][0], xy_m[at][1] - xy_m[at - 1][1]);
  }
  return length_m;
}

/** @param {(number | null)[]} values @returns {number | null} */
export function medianOf(values) {
  const known = /** @type {number[]} */ (values.filter((v) => v !== null && Number.isFinite(v)));
  known.sort((a, b) => a - b);
  return known.length === 0 ? null : (known[(known.length - 1) >> 1] + known[known.length >> 1]) / 2;
}

/** What is known of the square at a place; null outside. @param {Coverage} coverage @param {Point} xy_m
 * @returns {{walks: number | null, sigma_m: number | null} | null} */
export function cellAt({ corner_m, cell_m, shape, walks, sigma_m }, [x_m, y_m]) {
  const column = Math.floor((x_m - corner_m[0]) / cell_m);
  const row = Math.floor((y_m - corner_m[1]) / cell_m);
  if (row < 0 || column < 0 || row >= shape[0] || column >= shape[1]) return null;
  if (!walks[row][column]) return null;
  return { walks: walks[row][column], sigma_m: sigma_m[row][column] };
}

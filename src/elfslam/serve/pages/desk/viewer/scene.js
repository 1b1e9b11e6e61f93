// A map as the viewer needs it: walks with their lengths, paths and an index of every footstep.

import { withoutMarks } from "../../shared/format.js";
import { around, boundsOf, fit } from "../../shared/map/projection.js";
import { t } from "../../shared/words.js";

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
/** @typedef {GivenWalk & {length_m: number, duration_s: number, middle_sigma_m: number | null, bands: Stretch[]}} Walk */
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

// What lies nearest to a point: a grid over many points. Pure.

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

// Uncertainty as a soft band: stretches of a walk of about the same sigma. Pure.

/** @typedef {{sigma_m: number, points: Point[]}} Stretch */

/** Sigmas this alike are drawn alike. */
export const STEP_OF_SIGMA = 1.15;

/**
 * A walk cut where its sigma changes; neighbours share a point, so that the band has no gaps.
 * @param {Point[]} xy_m @param {(number | null)[]} sigma_m @returns {Stretch[]}
 */
export function stretches(xy_m, sigma_m) {
  /** @type {Stretch[]} */
  const found = [];
  let level = NaN;
  for (let at = 0; at < xy_m.length; at += 1) {
    const next = levelOf(sigma_m[at]);
    if (next !== level) {
      if (found.length > 0 && !Number.isNaN(level)) found[found.length - 1].points.push(xy_m[at]);
      if (!Number.isNaN(next)) found.push({ sigma_m: STEP_OF_SIGMA ** next, points: [xy_m[at]] });
    } else if (!Number.isNaN(next)) {
      found[found.length - 1].points.push(xy_m[at]);
    }
    level = next;
  }
  return found;
}

/** @param {number | null | undefined} sigma_m @returns {number} NaN where nothing is known */
function levelOf(sigma_m) {
  if (sigma_m === null || sigma_m === undefined || !(sigma_m > 0)) return NaN;
  return Math.round(Math.log(sigma_m) / Math.log(STEP_OF_SIGMA));
}

// Colours for numbers and for walks. Pure. Scales rise evenly in lightness and are read the same
// by people with any kind of colour vision (viridis: S. van der Walt and N. Smith 2015; cividis:
// J. R. Nunez, C. R. Anderton and R. S. Renslow 2018), given here by nine stops each.

/** @typedef {[number, number, number]} Rgb 0 to 255 */

/** @type {Record<string, string[]>} */
const STOPS = {
  viridis: ["440154", "472d7b", "3b528b", "2c728e", "21918c", "28ae80", "5ec962", "addc30", "fde725"],
  cividis: ["00224e", "1a386f", "434e6c", "61656f", "7d7c78", "9b9476", "bcae6c", "dec958", "fee838"],
};

/** @param {string} hex six digits, with or without # @returns {Rgb} */
export function rgbOf(hex) {
  const number = Number.parseInt(hex.replace("#", ""), 16);
  return [number >> 16, (number >> 8) & 255, number & 255];
}

/** @param {"viridis" | "cividis"} scale @param {number} share 0 to 1 @returns {Rgb} */
export function colourAt(scale, share) {
  const stops = STOPS[scale];
  const at = Math.min(1, Math.max(0, share)) * (stops.length - 1);
  const low = Math.min(Math.floor(at), stops.length - 2);
  const [from, to] = [rgbOf(stops[low]), rgbOf(stops[low + 1])];
  return /** @type {Rgb} */ (from.map((value, k) => Math.round(value + (to[k] - value) * (at - low))));
}

/** @param {Rgb} rgb @param {number} [alpha] */
export function css([red, green, blue], alpha = 1) {
  return `rgb(${red} ${green} ${blue} / ${alpha})`;
}

/** Lines on a ground need contrast: time runs over the part of viridis that has it.
 * @param {number} share 0 to 1 @param {boolean} dark @returns {Rgb} */
export function timeColour(share, dark) {
  return colourAt("viridis", dark ? 0.36 + 0.64 * share : 0.66 * share);
}

/** Relative luminance (WCAG 2.2). @param {Rgb} rgb @returns {number} 0 to 1 */
export function luminance(rgb) {
  const [r, g, b] = rgb.map((value) => {
    const share = value / 255;
    return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/** Contrast ratio (WCAG 2.2). @param {Rgb} one @param {Rgb} other @returns {number} 1 to 21 */
export function contrast(one, other) {
  const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
  return (high + 0.05) / (low + 0.05);
}

/**
 * Round limits for a scale over numbers that may hold nulls; null where there is no number.
 * @param {(number | null)[][]} rows @returns {{low: number, high: number} | null}
 */
export function limitsOf(rows) {
  const numbers = rows.flat().filter((value) => value !== null && Number.isFinite(value));
  if (numbers.length === 0) return null;
  const values = /** @type {number[]} */ (numbers);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  return { low, high: high > low ? high : low + Math.max(Math.abs(low) * 0.1, 1e-3) };
}

// What the viewer shows at this moment, and the colours of the page it shows it in.

/** @typedef {{image: HTMLImageElement, negative: HTMLCanvasElement | HTMLImageElement, aspect: number, placement: import("../../shared/map/placement.js").Placement, inverted: boolean | null}} Plan */
/** @typedef {{id: string, name: string, fixes: Fix[], shown: boolean}} Located */
/** @typedef {{kind: "step", walk: number, step: number} | {kind: "fix", located: number, fix: number} | {kind: "cell", xy_m: Point}} Focus */
/** @typedef {"plan" | "coverage" | "uncertainty" | "reckoning" | "closures" | "trajectories" | "fixes" | "points"} Layer */
/**
 * @typedef {object} State
 * @property {import("../../shared/map/projection.js").View} view
 * @property {import("../../shared/map/projection.js").Size} size
 * @property {Record<Layer, boolean>} layers
 * @property {"walk" | "time"} colourBy
 * @property {"walks" | "sigma_m"} coverageBy
 * @property {Set<number>} hidden walks that are switched off
 * @property {number | null} chosen the walk that stands out
 * @property {Focus | null} focus what is under the finger
 * @property {Plan | null} plan
 * @property {boolean} placing whether the floor plan can be dragged
 * @property {import("./plan_panel.js").Tie | null} tie the places by which the plan is being scaled or placed
 * @property {import("../../shared/map/points_of_interest.js").PointOfInterest[]} points
 * @property {import("../../shared/map/points_of_interest.js").PointOfInterest | null} point the one that stands out
 * @property {boolean} naming whether the next tap names a place
 * @property {Located[]} located
 * @property {import("./live.js").Walker[]} live who lets others see where they are
 * @property {boolean} hurried whether a map with very many footsteps is being moved: the band of uncertainty waits
 */

/** @param {Scene} scene @returns {State} */
export function firstState(scene) {
  const size = { width: 800, height: 600 };
  return {
    view: fit(scene.drawn_m, size),
    size,
    layers: {
      plan: true, coverage: scene.walks.length === 0, uncertainty: true, reckoning: false,
      closures: scene.closures.length > 0, trajectories: true, fixes: true, points: true,
    },
    colourBy: "walk",
    coverageBy: "walks",
    hidden: new Set(),
    chosen: null,
    focus: null,
    plan: null,
    placing: false,
    tie: null,
    points: [],
    point: null,
    naming: false,
    located: [],
    live: [],
    hurried: false,
  };
}

/** The colours of the page as they are now.
 * @returns {import("./draw.js").Palette & {status: Record<string, string>}} */
export function paletteOf() {
  const style = getComputedStyle(document.documentElement);
  const colour = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
  return {
    dark: matchMedia("(prefers-color-scheme: dark)").matches,
    surface: colour("--surface"),
    ink: colour("--ink"),
    soft: colour("--ink-soft"),
    line: colour("--line"),
    accent: colour("--accent"),
    reckoned: colour("--reckoned"),
    closure: colour("--closure"),
    walks: [1, 2, 3, 4, 5, 6].map((n) => colour(`--walk-${n}`)),
    status: {
      OK: colour("--good"), AMBIGUOUS: colour("--doubt"), UNKNOWN_PLACE: colour("--bad"), NO_ECHO: colour("--ink-soft"),
      SUSPECT: colour("--closure"),
    },
  };
}

// Located walks: the CSV of a locate job. Pure.

/** @typedef {{t_s: number, xy_m: [number, number] | null, heading_rad: number | null, sigma_m: number | null, status: string}} Fix */

const FIX_COLUMNS = ["t_s", "x_m", "y_m", "heading_rad", "sigma_m", "status"];

/** What the statuses mean to people. @type {Record<string, string>} */
export const STATUS_WORDS = {
  OK: t("located"),
  AMBIGUOUS: t("several places sound alike"),
  UNKNOWN_PLACE: t("unknown place"),
  NO_ECHO: t("no echo heard"),
  SUSPECT: t("sound not to be trusted"),
};

/** The rows of a fixes file; columns by name. Throws Error naming what is missing.
 * @param {string} text @param {number | null} [level] of a building: what is on other floors is left out, and what
 * is on none that is known has no place @returns {Fix[]} */
export function parseFixes(text, level = null) {
  const [head, ...lines] = text.trim().split(/\r?\n/);
  const names = head.split(",");
  const missing = FIX_COLUMNS.filter((name) => !names.includes(name));
  if (missing.length > 0) throw new Error(t("The fixes lack the column {{column}}; locate again.", { column: missing[0] }));
  const on = names.indexOf("level");
  return lines.filter((line) => line !== "").map((line) => line.split(","))
    .filter((cells) => on < 0 || cells[on] === "" || Number(cells[on]) === level)
    .map((cells) => ({ ...fixOf(names, cells), ...(cells[on] === "" ? { xy_m: null } : {}) }));
}

/** @param {string[]} names @param {string[]} cells @returns {Fix} */
function fixOf(names, cells) {
  const cell = (/** @type {string} */ name) => cells[names.indexOf(name)] ?? "";
  const number = (/** @type {string} */ name) => (cell(name) === "" ? null : Number(cell(name)));
  const [x_m, y_m] = [number("x_m"), number("y_m")];
  return {
    t_s: Number(cell("t_s")),
    xy_m: x_m === null || y_m === null ? null : [x_m, y_m],
    heading_rad: number("heading_rad"),
    sigma_m: number("sigma_m"),
    status: cell("status"),
  };
}

/** How many fixes have each status, the most frequent first. @param {Fix[]} fixes
 * @returns {[string, number][]} */
export function countStatuses(fixes) {
  /** @type {Map<string, number>} */
  const counts = new Map();
  for (const { status } of fixes) counts.set(status, (counts.get(status) ?? 0) + 1);
  return [...counts].sort((a, b) => b[1] - a[1]);
}

// What the viewer shows at this moment, and the colours of the page it shows it in.

import { fit } from "../../shared/map/projection.js";
import { t } from "../../shared/words.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
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
 * @property {import("./georeferencing.js").Tie | null} tie the places by which the plan is being scaled or placed
 * @property {import("../../shared/map/points_of_interest.js").PointOfInterest[]} points
 * @property {import("../../shared/map/points_of_interest.js").PointOfInterest | null} point the one that stands out
 * @property {boolean} naming whether the next tap names a place
 * @property {Located[]} located
 * @property {import("./live.js").Walker[]} live who lets others see where they are
 * @property {boolean} hurried whether a map with very many footsteps is being moved: the band of uncertainty waits
 */

/** @param {import("./scene.js").Scene} scene @returns {State} */
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

/** The colours of the page as they are now. @param {Element} element
 * @returns {import("./draw.js").Palette & {status: Record<string, string>}} */
export function paletteOf(element) {
  const style = getComputedStyle(element);
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

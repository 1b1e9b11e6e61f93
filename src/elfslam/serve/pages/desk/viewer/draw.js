// The map on a canvas, layer over layer. Paths are kept in metres; the canvas does the rest.

import { dot, drawGrid, drawPlan, inMetres, stroke } from "../../shared/map/ground.js";
import { toScreen } from "../../shared/map/projection.js";
import { colourAt, css, timeColour } from "./scene.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("./scene.js").Scene} Scene */
/** @typedef {import("./state.js").State} State */

/** @typedef {{dark: boolean, surface: string, ink: string, soft: string, line: string, accent: string, reckoned: string, closure: string, walks: string[]}} Palette */

const COVERAGE_ALPHA = 0.62;
const BAND_SIGMAS = [2, 1.5, 1, 0.5];
const BAND_ALPHA = 0.08;

/** @type {WeakMap<HTMLCanvasElement, HTMLCanvasElement>} */
const SHEETS = new WeakMap();

/** Everything that is switched on. @param {CanvasRenderingContext2D} context @param {Scene} scene
 * @param {State} state @param {Palette} palette @param {number} density device pixels per pixel */
export function draw(context, scene, state, palette, density) {
  const paths = pathsOf(scene);
  const { layers, size } = state;
  context.setTransform(density, 0, 0, density, 0, 0);
  context.clearRect(0, 0, size.width, size.height);
  drawGrid(context, state, palette);
  if (layers.plan) drawPlan(context, state);
  if (layers.coverage) drawCoverage(context, scene, state, paths);
  inMetres(context, state, density);
  if (layers.uncertainty && !state.hurried) drawBands(context, scene, state, palette, paths);
  if (layers.reckoning) drawReckoned(context, scene, state, palette, paths);
  if (layers.trajectories) drawWalks(context, scene, state, palette, paths);
  if (layers.closures) stroke(context, paths.closures, palette.closure, 1.75, state, Math.min(0.75, Math.max(0.2, 600 / scene.closures.length)));
  context.setTransform(density, 0, 0, density, 0, 0);
  if (layers.trajectories) drawEnds(context, scene, state, palette);
}

/** @param {CanvasRenderingContext2D} context @param {Scene} scene @param {State} state
 * @param {Paths} paths */
function drawCoverage(context, { coverage }, { coverageBy, view, size }, paths) {
  const cells = paths.coverage[coverageBy];
  if (!coverage || !cells) return;
  const [x, y] = toScreen(view, size, coverage.corner_m);
  const side_px = coverage.cell_m * view.px_per_m;
  context.save();
  context.globalAlpha = COVERAGE_ALPHA;
  context.imageSmoothingEnabled = false;
  context.setTransform(context.getTransform().translate(x, y).scale(1, -1));
  context.drawImage(cells, 0, 0, cells.width * side_px, cells.height * side_px);
  context.restore();
}

/** Another canvas of the same size, made once. @param {HTMLCanvasElement} canvas */
function sheetFor(canvas) {
  const sheet = SHEETS.get(canvas) ?? document.createElement("canvas");
  SHEETS.set(canvas, sheet);
  if (sheet.width !== canvas.width) sheet.width = canvas.width;
  if (sheet.height !== canvas.height) sheet.height = canvas.height;
  return sheet;
}

/** From two sigmas inwards, ever stronger; overlaps do not add up.
 * @param {CanvasRenderingContext2D} context @param {Scene} scene @param {State} state
 * @param {Palette} palette @param {Paths} paths */
function drawBands(context, scene, state, palette, paths) {
  const sheet = sheetFor(context.canvas);
  const ink = /** @type {CanvasRenderingContext2D} */ (sheet.getContext("2d"));
  for (const sigmas of BAND_SIGMAS) {
    ink.setTransform(1, 0, 0, 1, 0, 0);
    ink.clearRect(0, 0, sheet.width, sheet.height);
    ink.setTransform(context.getTransform());
    ink.lineCap = ink.lineJoin = "round";
    scene.walks.forEach((walk, at) => {
      if (state.hidden.has(at)) return;
      ink.strokeStyle = colourOf(palette, at);
      walk.bands.forEach(({ sigma_m }, band) => {
        ink.lineWidth = 2 * sigmas * sigma_m;
        ink.stroke(paths.bands[at][band]);
      });
    });
    context.save();
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.globalAlpha = BAND_ALPHA;
    context.drawImage(sheet, 0, 0);
    context.restore();
  }
}

/** @param {CanvasRenderingContext2D} context @param {Scene} scene @param {State} state
 * @param {Palette} palette @param {Paths} paths */
function drawReckoned(context, scene, state, palette, paths) {
  const shown = new Set(scene.walks.filter((_, at) => !state.hidden.has(at)).map((walk) => walk.name));
  context.setLineDash([6 / state.view.px_per_m, 5 / state.view.px_per_m]);
  scene.reckoned.forEach((walk, at) => {
    if (shown.has(walk.name)) stroke(context, paths.reckoned[at], palette.reckoned, 1.5, state);
  });
  context.setLineDash([]);
}

/** @param {CanvasRenderingContext2D} context @param {Scene} scene @param {State} state
 * @param {Palette} palette @param {Paths} paths */
function drawWalks(context, scene, state, palette, paths) {
  scene.walks.forEach((_, at) => {
    if (state.hidden.has(at)) return;
    const width_px = state.chosen === at ? 4 : 2;
    const alpha = state.chosen === null || state.chosen === at ? 1 : 0.35;
    if (state.colourBy === "walk") {
      stroke(context, paths.walks[at], colourOf(palette, at), width_px, state, alpha);
    } else {
      paths.times[at].forEach((path, shade) =>
        stroke(context, path, css(timeColour(shade / (SHADES - 1), palette.dark)), width_px, state, alpha));
    }
  });
}

/** A ring where a walk began, a dot where it ended. @param {CanvasRenderingContext2D} context
 * @param {Scene} scene @param {State} state @param {Palette} palette */
function drawEnds(context, scene, state, palette) {
  context.lineWidth = 2;
  scene.walks.forEach(({ xy_m }, at) => {
    if (state.hidden.has(at) || xy_m.length === 0) return;
    const timed = (/** @type {number} */ share) => css(timeColour(share, palette.dark));
    const colour = (/** @type {number} */ share) => (state.colourBy === "time" ? timed(share) : colourOf(palette, at));
    dot(context, toScreen(state.view, state.size, xy_m[xy_m.length - 1]), 5, colour(1), palette.surface);
    dot(context, toScreen(state.view, state.size, xy_m[0]), 5, palette.surface, colour(0));
  });
}

/** @param {Palette} palette @param {number} walk */
export function colourOf(palette, walk) {
  return palette.walks[walk % palette.walks.length];
}

// The lines and squares of a map in metres, as the canvas draws them.

/** @typedef {ReturnType<typeof madeOf>} Paths */

/** How many shades time has. */
const SHADES = 24;

/** @type {WeakMap<Scene, Paths>} */
const KEPT = new WeakMap();

/** What a map is drawn of; made once. @param {Scene} scene @returns {Paths} */
function pathsOf(scene) {
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

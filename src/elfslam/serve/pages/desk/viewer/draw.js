// The map on a canvas, layer over layer. Paths are kept in metres; the canvas does the rest.

import { css, timeColour } from "./colours.js";
import { pathsOf, SHADES } from "./paths.js";
import { dot, drawGrid, drawPlan, inMetres, stroke } from "../../shared/map/ground.js";
import { toScreen } from "../../shared/map/projection.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("./scene.js").Scene} Scene */
/** @typedef {import("./state.js").State} State */
/** @typedef {import("./paths.js").Paths} Paths */
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

// The map on a canvas, layer over layer. Paths are kept in metres; the canvas does the rest.

import { css, timeColour } from "./colours.js";
import { pathsOf, SHADES } from "./paths.js";
import { imageMatrix } from "./placement.js";
import { scaleBar, toMap, toScreen } from "./projection.js";

/** @typedef {import("./projection.js").Point} Point */
/** @typedef {import("./scene.js").Scene} Scene */
/** @typedef {import("./state.js").State} State */
/** @typedef {import("./paths.js").Paths} Paths */
/** @typedef {{dark: boolean, surface: string, ink: string, soft: string, line: string, accent: string, reckoned: string, closure: string, walks: string[]}} Palette */

const COVERAGE_ALPHA = 0.62;
const BAND_SIGMAS = [2, 1.5, 1, 0.5];
const BAND_ALPHA = 0.08;
const GRID_PX = 90;

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

/** @param {CanvasRenderingContext2D} context @param {State} state @param {number} density */
function inMetres(context, { view, size }, density) {
  const scale = density * view.px_per_m;
  const [x, y] = toScreen(view, size, [0, 0]);
  context.setTransform(scale, 0, 0, -scale, x * density, y * density);
  context.lineCap = context.lineJoin = "round";
}

/** @param {CanvasRenderingContext2D} context @param {Path2D} path @param {string} colour
 * @param {number} width_px @param {State} state @param {number} [alpha] */
function stroke(context, path, colour, width_px, { view }, alpha = 1) {
  context.globalAlpha = alpha;
  context.strokeStyle = colour;
  context.lineWidth = width_px / view.px_per_m;
  context.stroke(path);
  context.globalAlpha = 1;
}

/** Faint lines, a round number of metres apart. @param {CanvasRenderingContext2D} context
 * @param {State} state @param {Palette} palette */
function drawGrid(context, { view, size }, palette) {
  const { length_m } = scaleBar(view.px_per_m, 2 * GRID_PX);
  const [left, top] = toMap(view, size, [0, 0]);
  const [right, bottom] = toMap(view, size, [size.width, size.height]);
  context.beginPath();
  for (let x = Math.ceil(left / length_m); x * length_m < right; x += 1) {
    const [x_px] = toScreen(view, size, [x * length_m, 0]);
    context.moveTo(Math.round(x_px) + 0.5, 0);
    context.lineTo(Math.round(x_px) + 0.5, size.height);
  }
  for (let y = Math.ceil(bottom / length_m); y * length_m < top; y += 1) {
    const [, y_px] = toScreen(view, size, [0, y * length_m]);
    context.moveTo(0, Math.round(y_px) + 0.5);
    context.lineTo(size.width, Math.round(y_px) + 0.5);
  }
  context.strokeStyle = palette.line;
  context.globalAlpha = 0.55;
  context.lineWidth = 1;
  context.stroke();
  context.globalAlpha = 1;
}

/** @param {CanvasRenderingContext2D} context @param {State} state */
function drawPlan(context, { plan, view, size }) {
  if (!plan) return;
  const matrix = imageMatrix(plan.placement, plan.aspect, (xy) => toScreen(view, size, xy));
  context.save();
  context.globalAlpha = plan.placement.opacity;
  context.imageSmoothingQuality = "high";
  context.transform(...matrix);
  context.drawImage(plan.inverted ? plan.negative : plan.image, 0, 0, 1, 1);
  context.restore();
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

/** @param {CanvasRenderingContext2D} context @param {Point} at_px @param {number} radius_px
 * @param {string} inside @param {string} around */
export function dot(context, [x, y], radius_px, inside, around) {
  context.beginPath();
  context.arc(x, y, radius_px, 0, 2 * Math.PI);
  context.fillStyle = inside;
  context.strokeStyle = around;
  context.fill();
  context.stroke();
}

/** @param {Palette} palette @param {number} walk */
export function colourOf(palette, walk) {
  return palette.walks[walk % palette.walks.length];
}

// The map on a canvas, layer over layer. Paths are kept in metres; the canvas does the rest.

import { dot, drawGrid, drawPlan, inMetres, stroke } from "../../shared/map/ground.js";
import { corners, middle } from "../../shared/map/placement.js";
import { drawPointsOfInterest } from "../../shared/map/points_of_interest.js";
import { toScreen } from "../../shared/map/projection.js";
import { placesOf } from "./plan_panel.js";
import { colourAt, css, timeColour } from "./scene.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("./scene.js").Scene} Scene */
/** @typedef {import("./scene.js").State} State */

/** @typedef {{dark: boolean, surface: string, ink: string, soft: string, line: string, accent: string, reckoned: string, closure: string, walks: string[]}} Palette */
/** @typedef {ReturnType<typeof import("./scene.js").paletteOf>} PagePalette */

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

// What lies on top of the map: located walks, what is under the finger, the handles of a plan.

export const HANDLE_PX = 9;
const KNOB_PX = 34;

/** @param {CanvasRenderingContext2D} context @param {import("./scene.js").Scene} scene
 * @param {State} state @param {PagePalette} palette */
export function drawMarks(context, scene, state, palette) {
  if (state.layers.fixes) state.located.filter((walk) => walk.shown).forEach((walk) => drawLocated(context, walk, state, palette));
  if (state.layers.points) drawPointsOfInterest(context, state, state.points, palette, state.point);
  drawFocus(context, scene, state, palette);
  if (state.placing && state.plan) drawHandles(context, state, palette);
  if (state.tie && state.plan) drawTie(context, state, palette);
}

/** @param {CanvasRenderingContext2D} context @param {import("./scene.js").Located} located
 * @param {State} state @param {PagePalette} palette */
function drawLocated(context, { fixes }, { view, size }, palette) {
  const placed = fixes.filter((fix) => fix.xy_m !== null);
  const at_px = placed.map((fix) => toScreen(view, size, /** @type {Point} */ (fix.xy_m)));
  context.setLineDash([2, 5]);
  context.strokeStyle = palette.ink;
  context.lineWidth = 1.5;
  context.beginPath();
  at_px.forEach(([x, y], at) => (at === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
  context.stroke();
  context.setLineDash([]);
  placed.forEach((fix, at) => mark(context, at_px[at], fix.status, palette));
}

/** A disc where located, a triangle where in doubt, a square where unknown: not by colour alone.
 * @param {CanvasRenderingContext2D} context @param {Point} at_px @param {string} status
 * @param {PagePalette} palette */
export function mark(context, [x, y], status, palette) {
  const r = 5;
  context.beginPath();
  if (status === "OK") context.arc(x, y, r, 0, 2 * Math.PI);
  else if (status === "AMBIGUOUS") polygon(context, [[x, y - r - 1], [x + r + 1, y + r], [x - r - 1, y + r]]);
  else polygon(context, [[x - r, y - r], [x + r, y - r], [x + r, y + r], [x - r, y + r]]);
  context.lineWidth = 1.5;
  context.fillStyle = palette.status[status] ?? palette.soft;
  context.strokeStyle = palette.surface;
  context.fill();
  context.stroke();
}

/** @param {CanvasRenderingContext2D} context @param {Point[]} points */
function polygon(context, points) {
  points.forEach(([x, y], at) => (at === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
  context.closePath();
}

/** Where the focus lies and how sure that is. @param {import("./scene.js").Scene} scene
 * @param {State} state @returns {{xy_m: Point, sigma_m: number | null} | null} */
export function focusPlace(scene, { focus, located }) {
  if (focus?.kind === "step") {
    const walk = scene.walks[focus.walk];
    return { xy_m: walk.xy_m[focus.step], sigma_m: walk.sigma_m?.[focus.step] ?? null };
  }
  if (focus?.kind === "fix") {
    const fix = located[focus.located].fixes[focus.fix];
    return fix.xy_m && { xy_m: fix.xy_m, sigma_m: fix.sigma_m };
  }
  return null;
}

/** @param {CanvasRenderingContext2D} context @param {import("./scene.js").Scene} scene
 * @param {State} state @param {PagePalette} palette */
function drawFocus(context, scene, state, palette) {
  const place = focusPlace(scene, state);
  if (!place) return;
  const at_px = toScreen(state.view, state.size, place.xy_m);
  if (place.sigma_m !== null) {
    context.beginPath();
    context.arc(...at_px, Math.max(place.sigma_m * state.view.px_per_m, 1), 0, 2 * Math.PI);
    context.setLineDash([4, 4]);
    context.strokeStyle = palette.ink;
    context.lineWidth = 1.5;
    context.stroke();
    context.setLineDash([]);
  }
  context.lineWidth = 3;
  dot(context, at_px, 6, palette.accent, palette.surface);
}

/** The four corners, and the knob that turns. @param {State} state @returns {{corners: Point[], knob: Point, top: Point}} */
export function handlesOf({ plan, view, size }) {
  if (!plan) return { corners: [], knob: [0, 0], top: [0, 0] };
  const places = corners(plan.placement, plan.aspect).map((xy) => toScreen(view, size, xy));
  const [cx, cy] = toScreen(view, size, middle(plan.placement, plan.aspect));
  const top = /** @type {Point} */ ([(places[2][0] + places[3][0]) / 2, (places[2][1] + places[3][1]) / 2]);
  const away = Math.hypot(top[0] - cx, top[1] - cy) || 1;
  const knob = /** @type {Point} */ ([
    top[0] + ((top[0] - cx) / away) * KNOB_PX, top[1] + ((top[1] - cy) / away) * KNOB_PX]);
  return { corners: places, knob, top };
}

/** @param {CanvasRenderingContext2D} context @param {State} state @param {PagePalette} palette */
function drawHandles(context, state, palette) {
  const { corners: places, knob, top } = handlesOf(state);
  context.strokeStyle = palette.accent;
  context.lineWidth = 1.5;
  context.setLineDash([5, 4]);
  context.beginPath();
  polygon(context, places);
  context.moveTo(...top);
  context.lineTo(...knob);
  context.stroke();
  context.setLineDash([]);
  context.lineWidth = 2.5;
  for (const [x, y] of places) {
    context.beginPath();
    context.rect(x - HANDLE_PX + 2, y - HANDLE_PX + 2, 2 * HANDLE_PX - 4, 2 * HANDLE_PX - 4);
    context.fillStyle = palette.surface;
    context.fill();
    context.stroke();
  }
  dot(context, knob, HANDLE_PX - 1, palette.surface, palette.accent);
}

/** The places by which a plan is tied, numbered: discs on the plan, rings on the map, a line between.
 * @param {CanvasRenderingContext2D} context @param {State} state @param {PagePalette} palette */
function drawTie(context, { tie, plan, view, size }, palette) {
  if (!tie || !plan) return;
  const places = placesOf(tie, plan.placement).map((xy) => toScreen(view, size, xy));
  const others = (tie.kind === "length" ? places.slice(1) : tie.map.map((xy) => toScreen(view, size, xy)));
  context.strokeStyle = palette.accent;
  context.lineWidth = 2;
  others.forEach((other, at) => {
    context.beginPath();
    polygon(context, [places[at], other]);
    context.stroke();
  });
  context.lineWidth = 3;
  others.forEach((other) => dot(context, other, 9, "transparent", palette.accent));
  context.font = "650 15px system-ui, sans-serif";
  places.forEach((place, at) => {
    dot(context, place, 6, palette.accent, palette.surface);
    context.fillStyle = palette.ink;
    context.fillText(String(at + 1), place[0] + 11, place[1] - 9);
  });
}

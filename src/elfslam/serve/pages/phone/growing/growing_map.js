/** The walk so far on a canvas: what is covered, the way, loops that have closed, and what to walk next. */

import { density, dot, drawGrid, inMetres, makeScale, mountSurface, stroke } from "../../shared/map/ground.js";
import { boundsOf, fit, toScreen } from "../../shared/map/projection.js";
import { paletteOf } from "../locating/place_map.js";
import { at } from "../view.js";

/** So far around the walker a floor counts as covered: a lane. */
const LANE_M = 0.8;
const MARGIN_PX = 26;
/** No closer than that, however short the walk. */
const LEAST_M = 4;
const WAY_PX = 3;
const DOT_PX = 8;
const NAME_PX = 14;

/**
 * @typedef {import("./sketch.js").Sketch} Sketch
 * @typedef {import("../../shared/map/projection.js").Point} Point
 * @typedef {{view: import("../../shared/map/projection.js").View, size: import("../../shared/map/projection.js").Size,
 *   sketch: Sketch | null}} Shown
 */

/** On the view of a walk. @returns {{show: (sketch: Sketch) => void, leave: () => void}} */
export function mountGrowingMap() {
  const canvas = at("growing-canvas");
  /** @type {Shown} */
  const shown = { view: { x_m: 0, y_m: 0, px_per_m: 40 }, size: { width: 340, height: 220 }, sketch: null };
  let palette = paletteOf(document.documentElement);
  const scale = makeScale();
  at("growing-stage").append(scale.bar);
  const turn = () => {
    if (shown.sketch) shown.view = fit(boundsAround(placesOf(shown.sketch.poses)), shown.size, MARGIN_PX);
  };
  const { redraw, leave } = mountSurface(canvas, {
    paint() {
      drawSketch(canvas.getContext("2d"), shown, palette, density());
      scale.show(shown.view);
    },
    resized(size) {
      shown.size = size;
      turn();
    },
    recoloured: () => {
      palette = paletteOf(document.documentElement);
    },
  });
  redraw();
  return {
    show(sketch) {
      shown.sketch = sketch;
      turn();
      redraw();
    },
    leave() {
      leave();
      scale.bar.remove();
      canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
    },
  };
}

/** @param {Float64Array} poses @returns {Point[]} */
export function placesOf(poses) {
  return Array.from({ length: poses.length / 3 }, (_, k) => [poses[3 * k], poses[3 * k + 1]]);
}

/** Around all of it, and never less than a room. @param {Point[]} places
 * @returns {import("../../shared/map/projection.js").Bounds} */
function boundsAround(places) {
  const [x0, y0, x1, y1] = boundsOf(places) ?? [0, 0, 0, 0];
  const [wide, high] = [Math.max(LEAST_M - (x1 - x0), 2 * LANE_M) / 2, Math.max(LEAST_M - (y1 - y0), 2 * LANE_M) / 2];
  return [x0 - wide, y0 - high, x1 + wide, y1 + high];
}

/** @param {CanvasRenderingContext2D} context @param {Shown} shown
 * @param {import("../locating/draw_place.js").Palette} palette @param {number} pixels per pixel of the page */
function drawSketch(context, shown, palette, pixels) {
  const { size, view, sketch } = shown;
  context.setTransform(pixels, 0, 0, pixels, 0, 0);
  context.clearRect(0, 0, size.width, size.height);
  drawGrid(context, shown, palette);
  if (!sketch) return;
  const places = placesOf(sketch.poses);
  inMetres(context, shown, pixels);
  const way = wayOf(places, new Set(sketch.gaps));
  stroke(context, way, palette.accentSoft, 2 * LANE_M * view.px_per_m, shown);
  stroke(context, loopsOf(sketch.loops, places), palette.accent, 1.5, shown, 0.6);
  stroke(context, way, palette.ink, WAY_PX, shown, 0.85);
  if (sketch.next) drawNext(context, shown, places.slice(sketch.next[0], sketch.next[1] + 1), palette);
  context.setTransform(pixels, 0, 0, pixels, 0, 0);
  drawMarks(context, shown, places, palette);
  context.lineWidth = 3;
  dot(context, toScreen(view, size, places[places.length - 1]), DOT_PX, palette.accent, palette.surface);
}

/** @param {Point[]} places @param {Set<number>} gaps */
function wayOf(places, gaps) {
  const path = new Path2D();
  places.forEach(([x, y], k) => (k === 0 || gaps.has(k) ? path.moveTo(x, y) : path.lineTo(x, y)));
  return path;
}

/** @param {[number, number][]} loops @param {Point[]} places */
function loopsOf(loops, places) {
  const path = new Path2D();
  for (const [i, j] of loops) {
    path.moveTo(...places[i]);
    path.lineTo(...places[j]);
  }
  return path;
}

/** Dashed, so that it is told by more than its colour. @param {CanvasRenderingContext2D} context @param {Shown} shown
 * @param {Point[]} places @param {import("../locating/draw_place.js").Palette} palette */
function drawNext(context, shown, places, palette) {
  const { px_per_m } = shown.view;
  context.setLineDash([10 / px_per_m, 9 / px_per_m]);
  stroke(context, wayOf(places, new Set()), palette.surface, WAY_PX + 4, shown);
  stroke(context, wayOf(places, new Set()), palette.doubt, WAY_PX + 2, shown);
  context.setLineDash([]);
}

/** @param {CanvasRenderingContext2D} context @param {Shown} shown @param {Point[]} places
 * @param {import("../locating/draw_place.js").Palette} palette */
function drawMarks(context, { view, size, sketch }, places, palette) {
  /** @type {Set<string>} */
  const named = new Set();
  context.font = `600 ${NAME_PX}px ${getComputedStyle(document.body).fontFamily}`;
  for (const { name, at: footstep } of sketch?.marks ?? []) {
    const [x, y] = toScreen(view, size, places[footstep]);
    context.lineWidth = 2;
    dot(context, [x, y], DOT_PX - 2, palette.surface, palette.ink);
    if (named.has(name)) continue;
    named.add(name);
    context.lineWidth = 4;
    context.strokeStyle = palette.surface;
    context.fillStyle = palette.ink;
    context.strokeText(name, x + DOT_PX + 2, y + NAME_PX / 3);
    context.fillText(name, x + DOT_PX + 2, y + NAME_PX / 3);
  }
}

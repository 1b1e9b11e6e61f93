/** The map with the walker on it, layer over layer. */

import { drawGrid, drawPlan, inMetres, stroke } from "../../shared/map/ground.js";
import { drawPointsOfInterest } from "../../shared/map/points_of_interest.js";
import { toScreen } from "../../shared/map/projection.js";
import { ellipseOf } from "./ellipse.js";

/** @typedef {import("./place_map.js").Shown} Shown */
/** @typedef {CanvasRenderingContext2D} Context */
/** @typedef {{surface: string, ink: string, soft: string, line: string, accent: string, accentSoft: string,
 *   doubt: string, bad: string}} Palette */

const DOT_PX = 9;
const BEAM_PX = 46;
const BEAM_RAD = 0.55;
const TRAIL_PX = 4;
const WAY_PX = 3;
/** Older pieces of the trail fade to this. */
const FAINT = 0.35;

/** @param {Context} context @param {Shown} shown @param {Palette} palette
 * @param {number} density device pixels per pixel */
export function drawPlace(context, shown, palette, density) {
  const { size, ground, trail } = shown;
  context.setTransform(density, 0, 0, density, 0, 0);
  context.clearRect(0, 0, size.width, size.height);
  drawGrid(context, shown, palette);
  drawPlan(context, shown);
  inMetres(context, shown, density);
  drawGround(context, shown, ground, palette);
  drawTrail(context, shown, palette);
  drawWay(context, shown, palette);
  context.setTransform(density, 0, 0, density, 0, 0);
  drawPointsOfInterest(context, shown, shown.points, palette, shown.goal);
  if (trail.placed) drawWalker(context, shown, trail.placed, palette);
}

/** @param {Context} context @param {Shown} shown @param {Shown["ground"]} ground @param {Palette} palette */
function drawGround(context, shown, { cover, walks }, palette) {
  context.globalAlpha = shown.plan ? 0.45 : 0.85;
  context.fillStyle = palette.accentSoft;
  context.fill(cover, "nonzero");
  context.globalAlpha = 1;
  stroke(context, walks, palette.accent, 1, shown, 0.3);
}

/** @param {Context} context @param {Shown} shown @param {Palette} palette */
function drawTrail(context, shown, palette) {
  const { pieces } = shown.trail;
  pieces.forEach((piece, at) => {
    const path = new Path2D();
    piece.forEach(([x, y], k) => (k === 0 ? path.moveTo(x, y) : path.lineTo(x, y)));
    const isLast = at === pieces.length - 1;
    stroke(context, path, palette.surface, TRAIL_PX + 3, shown, isLast ? 0.8 : 0.5);
    stroke(context, path, palette.accent, TRAIL_PX, shown, isLast ? 0.9 : FAINT);
  });
}

/** A broken line to where the walker wants to go. @param {Context} context @param {Shown} shown
 * @param {Palette} palette */
function drawWay(context, shown, palette) {
  if (shown.way.length < 2) return;
  const path = new Path2D();
  shown.way.forEach(([x, y], k) => (k === 0 ? path.moveTo(x, y) : path.lineTo(x, y)));
  stroke(context, path, palette.surface, WAY_PX + 3, shown, 0.8);
  context.setLineDash([2 * WAY_PX, 2 * WAY_PX].map((pixels) => pixels / shown.view.px_per_m));
  stroke(context, path, palette.ink, WAY_PX, shown);
  context.setLineDash([]);
}

/**
 * In the colour of what is known, and where it is in doubt with a broken line: not by colour alone.
 * @param {Context} context @param {Shown} shown @param {import("./words.js").Fix} fix of a place
 * @param {Palette} palette
 */
function drawWalker(context, { view, size, trail }, fix, palette) {
  const isLost = trail.fix !== fix;
  const isSure = !isLost && fix.status === "OK";
  const colour = isSure ? palette.accent : isLost || fix.status === "SUSPECT" ? palette.bad : palette.doubt;
  const [x, y] = toScreen(view, size, /** @type {[number, number]} */ (fix.xyM));
  context.save();
  context.translate(x, y);
  if (isLost) context.globalAlpha = 0.55;
  if (fix.covarianceM2) drawEllipse(context, ellipseOf(fix.covarianceM2), view.px_per_m, colour, isSure);
  if (Number.isFinite(fix.headingRad)) drawBeam(context, fix.headingRad, colour);
  drawDot(context, colour, palette.surface, isSure);
  context.restore();
}

/**
 * @param {Context} context @param {ReturnType<typeof ellipseOf>} ellipse @param {number} pxPerM
 * @param {string} colour @param {boolean} isSure
 */
function drawEllipse(context, { majorM, minorM, turnRad }, pxPerM, colour, isSure) {
  /** @param {number} metres */
  const half = (metres) => Math.max(metres * pxPerM, DOT_PX + 3);
  const alpha = context.globalAlpha;
  context.beginPath();
  context.ellipse(0, 0, half(majorM), half(minorM), -turnRad, 0, 2 * Math.PI);
  context.fillStyle = colour;
  context.strokeStyle = colour;
  context.globalAlpha = 0.16 * alpha;
  context.fill();
  context.globalAlpha = 0.9 * alpha;
  context.lineWidth = 1.5;
  context.setLineDash(isSure ? [] : [5, 4]);
  context.stroke();
  context.setLineDash([]);
  context.globalAlpha = alpha;
}

/**
 * Where the phone faces: a beam that fades.
 * @param {Context} context @param {number} headingRad @param {string} colour in hexadecimal
 */
function drawBeam(context, headingRad, colour) {
  const alpha = context.globalAlpha;
  const fade = context.createRadialGradient(0, 0, DOT_PX, 0, 0, BEAM_PX);
  fade.addColorStop(0, colour);
  fade.addColorStop(1, `${colour}00`);
  context.beginPath();
  context.moveTo(0, 0);
  context.arc(0, 0, BEAM_PX, -headingRad - BEAM_RAD, -headingRad + BEAM_RAD);
  context.closePath();
  context.fillStyle = fade;
  context.globalAlpha = 0.75 * alpha;
  context.fill();
  context.globalAlpha = alpha;
}

/** @param {Context} context @param {string} colour @param {string} surface @param {boolean} isSure */
function drawDot(context, colour, surface, isSure) {
  context.beginPath();
  context.arc(0, 0, DOT_PX, 0, 2 * Math.PI);
  context.lineWidth = 3;
  context.strokeStyle = isSure ? surface : colour;
  context.fillStyle = isSure ? colour : surface;
  context.fill();
  context.stroke();
}

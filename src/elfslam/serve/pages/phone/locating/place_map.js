/** The map on the canvas of the view: it follows the walker until a hand moves it. */

import { h, icon } from "../../shared/dom.js";
import { onGestures } from "../../shared/map/gestures.js";
import {
  density, drawGrid, drawPlan, inMetres, makeScale, mountSurface, stroke, zoomButtons,
} from "../../shared/map/ground.js";
import { corners } from "../../shared/map/placement.js";
import { drawPointsOfInterest } from "../../shared/map/points_of_interest.js";
import { around, boundsOf, fit, toScreen } from "../../shared/map/projection.js";
import { t } from "../../shared/words.js";
import { groundOf } from "./walked_ground.js";
import { ellipseOf } from "./words.js";

/** @typedef {import("../../shared/map/projection.js").View} View */
/**
 * What is on the canvas.
 * @typedef {object} Shown
 * @property {View} view
 * @property {import("../../shared/map/projection.js").Size} size
 * @property {import("./walked_ground.js").Ground} ground
 * @property {import("../../shared/map/ground.js").Plan | null} plan
 * @property {import("../../shared/map/points_of_interest.js").PointOfInterest[]} points
 * @property {import("../../shared/map/points_of_interest.js").PointOfInterest | null} goal where the walker wants to go
 * @property {import("../../shared/map/projection.js").Point[]} way there
 * @property {Trail} trail
 */

const HELP =
  t("Drag or arrow keys move the map, plus and minus zoom, 0 shows all, F follows you, Enter says where you are.");
/** Once the walker is found, no more of the map is shown than this. */
const AROUND_M = 8;
const MARGIN_PX = 28;

/**
 * @param {{xyM: Float32Array}} floorMap @param {string} name of the map
 * @param {{say: () => void}} told say: the walker asks where they are
 */
export function mountPlaceMap(floorMap, name, { say }) {
  const ground = groundOf(floorMap);
  const size = { width: 360, height: 420 };
  /** @type {Shown} */
  const shown = { view: fit(ground.bounds_m, size, MARGIN_PX), size, ground, plan: null, points: [], goal: null, way: [], trail: NO_TRAIL };
  let isFollowing = true;
  const canvas = h("canvas", { tabindex: "0", role: "application", "aria-roledescription": "map",
    "aria-label": `${t("Map {{name}}", { name })}. ${HELP}` });
  const scale = makeScale();
  const follow = h("button", { type: "button", class: "follow", "aria-pressed": "true", "aria-label": t("Follow me"),
    title: t("Follow me (F)"), click: () => setFollowing(!isFollowing) }, icon("follow"));
  const buttons = zoomButtons({ look: () => shown, turnTo: zoomTo, fit: showAll });
  const stage = h("div", { class: "stage" }, canvas, buttons, follow, scale.bar);
  let isSized = false;

  function paint(/** @type {Palette} */ palette) {
    const context = canvas.getContext("2d");
    context.save();
    drawPlace(context, shown, palette, density());
    context.restore();
    scale.show(shown.view);
  }

  /** @param {boolean} isWanted */
  function setFollowing(isWanted) {
    isFollowing = isWanted;
    follow.setAttribute("aria-pressed", String(isWanted));
    if (isWanted) centre();
    redraw();
  }

  /** Zooming keeps the walker in the middle while they are followed. @param {View} view */
  function zoomTo(view) {
    shown.view = view;
    if (isFollowing) centre();
    redraw();
  }

  /** @param {View} view */
  function moveTo(view) {
    if (view.px_per_m === shown.view.px_per_m) setFollowing(false);
    zoomTo(view);
  }

  function centre() {
    const place = shown.trail.placed?.xyM;
    if (place) shown.view = { ...shown.view, x_m: place[0], y_m: place[1] };
  }

  function showAll() {
    setFollowing(false);
    const planned = shown.plan ? boundsOf(corners(shown.plan.placement, shown.plan.aspect)) : null;
    shown.view = fit(around(ground.bounds_m, planned) ?? ground.bounds_m, shown.size, MARGIN_PX);
    redraw();
  }

  /** @param {Shown["trail"]} trail */
  function setTrail(trail) {
    const isFound = !shown.trail.placed && trail.placed;
    shown.trail = trail;
    if (isFollowing && isFound) comeCloser();
    if (isFollowing) centre();
    redraw();
  }

  function comeCloser() {
    const nearest = Math.min(shown.size.width, shown.size.height) / AROUND_M;
    shown.view = { ...shown.view, px_per_m: Math.max(shown.view.px_per_m, nearest) };
  }

  onGestures(canvas, {
    look: () => shown, turnTo: moveTo, fit: showAll, point() {}, leave() {}, grab: () => null, drop() {}, step() {},
  });
  canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.key === "Enter") say();
    if (event.key === "f" || event.key === "F") setFollowing(!isFollowing);
  });
  const { redraw, leave } = mountSurface(canvas, {
    paletteOf, paint,
    resized(now) {
      shown.size = now;
      if (!isSized) shown.view = fit(ground.bounds_m, now, MARGIN_PX);
      isSized = true;
      if (isFollowing) centre();
    },
  });
  /** @param {import("../../shared/map/ground.js").Plan} plan */
  const setPlan = (plan) => {
    shown.plan = plan;
    redraw();
  };
  /** @param {Shown["points"]} points */
  const setPoints = (points) => {
    shown.points = points;
    redraw();
  };
  /** @param {Shown["goal"]} goal @param {Shown["way"]} way */
  const setWay = (goal, way) => {
    [shown.goal, shown.way] = [goal, way];
    redraw();
  };
  return { stage, canvas, setTrail, setPlan, setPoints, setWay, leave };
}

/** The colours of the page as they are now. @returns {Palette} */
export function paletteOf() {
  const style = getComputedStyle(document.documentElement);
  /** @param {string} name */
  const colour = (name) => style.getPropertyValue(name).trim();
  return {
    surface: colour("--surface"), ink: colour("--ink"), soft: colour("--ink-soft"), line: colour("--line"),
    accent: colour("--accent"), accentSoft: colour("--accent-soft"), doubt: colour("--doubt"), bad: colour("--bad"),
  };
}

// The map with the walker on it, layer over layer.

/** @typedef {CanvasRenderingContext2D} Context */
/** @typedef {{surface: string, ink: string, soft: string, line: string, accent: string, accentSoft: string,
 *   doubt: string, bad: string}} Palette
 */

const DOT_PX = 9;
const BEAM_PX = 46;
const BEAM_RAD = 0.55;
const TRAIL_PX = 4;
const WAY_PX = 3;
/** Older pieces of the trail fade to this. */
const FAINT = 0.35;

/** @param {Context} context @param {Shown} shown @param {Palette} palette
 * @param {number} density device pixels per pixel */
function drawPlace(context, shown, palette, density) {
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

// What is shown of a walk that is being located: the last fix, and where it came along. Pure.

/** @typedef {import("./words.js").Fix} Fix */
/**
 * @typedef {object} Trail
 * @property {Fix | null} fix the last one
 * @property {Fix | null} placed the last one that has a place
 * @property {[number, number][][]} pieces lines without what lies between two places of which nothing is known
 * @property {number} count fixes with a place
 * @property {number} total fixes in all
 */

/** So many places are remembered: an hour's walk. */
const LONGEST = 7200;
/** Nobody takes such a step: the walker has been found anew. */
const LEAP_M = 2.5;

/** @type {Trail} */
export const NO_TRAIL = { fix: null, placed: null, pieces: [], count: 0, total: 0 };

/** @param {Trail} trail @param {Fix} fix @returns {Trail} */
export function withFix(trail, fix) {
  const total = trail.total + 1;
  if (!fix.xyM) return { ...trail, fix, total };
  const isOn = trail.fix?.xyM && distance(trail.fix.xyM, fix.xyM) < LEAP_M;
  const before = isOn ? trail.pieces.slice(0, -1) : trail.pieces;
  const last = isOn ? [...trail.pieces[trail.pieces.length - 1], fix.xyM] : [fix.xyM];
  return { fix, placed: fix, pieces: shortened([...before, last]), count: trail.count + 1, total };
}

/** @param {[number, number][][]} pieces */
function shortened(pieces) {
  let over = pieces.reduce((sum, piece) => sum + piece.length, 0) - LONGEST;
  if (over <= 0) return pieces;
  const kept = [];
  for (const piece of pieces) {
    const rest = piece.slice(Math.max(over, 0));
    over -= piece.length;
    if (rest.length > 0) kept.push(rest);
  }
  return kept;
}

/** @param {[number, number]} a @param {[number, number]} b */
function distance(a, b) {
  return Math.hypot(a[0] - b[0], a[1] - b[1]);
}

/** The map on the canvas of the view: it follows the walker until a hand moves it. */

import { h, icon } from "../../shared/dom.js";
import { onGestures } from "../../shared/map/gestures.js";
import { density, makeScale, mountSurface, zoomButtons } from "../../shared/map/ground.js";
import { corners } from "../../shared/map/placement.js";
import { around, boundsOf, fit } from "../../shared/map/projection.js";
import { drawPlace } from "./draw_place.js";
import { groundOf } from "./ground_of_map.js";
import { NO_TRAIL } from "./trail.js";
import { t } from "../../shared/words.js";

/** @typedef {import("../../shared/map/projection.js").View} View */
/**
 * What is on the canvas.
 * @typedef {object} Shown
 * @property {View} view
 * @property {import("../../shared/map/projection.js").Size} size
 * @property {import("./ground_of_map.js").Ground} ground
 * @property {import("../../shared/map/ground.js").Plan | null} plan
 * @property {import("../../shared/map/points_of_interest.js").PointOfInterest[]} points
 * @property {import("../../shared/map/points_of_interest.js").PointOfInterest | null} goal where the walker wants to go
 * @property {import("../../shared/map/projection.js").Point[]} way there
 * @property {import("./trail.js").Trail} trail
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
  let palette = paletteOf(document.documentElement);
  let isSized = false;

  function paint() {
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
    paint,
    resized(now) {
      shown.size = now;
      if (!isSized) shown.view = fit(ground.bounds_m, now, MARGIN_PX);
      isSized = true;
      if (isFollowing) centre();
    },
    recoloured: () => {
      palette = paletteOf(document.documentElement);
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

/** The colours of the page as they are now. @param {Element} element @returns {import("./draw_place.js").Palette} */
export function paletteOf(element) {
  const style = getComputedStyle(element);
  /** @param {string} name */
  const colour = (name) => style.getPropertyValue(name).trim();
  return {
    surface: colour("--surface"), ink: colour("--ink"), soft: colour("--ink-soft"), line: colour("--line"),
    accent: colour("--accent"), accentSoft: colour("--accent-soft"), doubt: colour("--doubt"), bad: colour("--bad"),
  };
}

// The canvas of the viewer: it draws when something has changed, and answers hands.

import { h } from "../../shared/dom.js";
import { formatDuration, formatMetres, formatNumber } from "../../shared/format.js";
import { onGestures } from "../../shared/map/gestures.js";
import { density, makeScale, mountSurface, zoomButtons } from "../../shared/map/ground.js";
import { corners, isOnPlan, middle, moved, stretched, turned } from "../../shared/map/placement.js";
import { around, boundsOf, fit, toMap, toScreen } from "../../shared/map/projection.js";
import { counted, t } from "../../shared/words.js";
import { draw, drawMarks, focusPlace, HANDLE_PX, handlesOf } from "./draw.js";
import { drawLive } from "./live.js";
import { cellAt, nearest, stepAt, paletteOf, STATUS_WORDS } from "./scene.js";

/** @typedef {import("./scene.js").State} State */
/** @typedef {import("./scene.js").Scene} Scene */

const MANY_FOOTSTEPS = 3000;
const CALM_MS = 150;
const HELP = t("Drag or arrow keys move, wheel or plus and minus zoom, 0 shows all, square brackets step along a walk.");

/**
 * @param {Scene} scene @param {State} state @param {string} name of the map
 * @param {{onPlacement: (placement: import("../../shared/map/placement.js").Placement, finished: boolean) => void, onTap: (xy_m: import("../../shared/map/projection.js").Point) => void}} told
 * `onTap` while a plan is tied to the walks, or a place is named
 */
export function mountCanvas(scene, state, name, told) {
  const canvas = h("canvas", { tabindex: "0", role: "application", "aria-roledescription": t("map"),
    "aria-label": `${t("Map {{name}}", { name })}. ${HELP}` });
  const tip = h("div", { class: "tip", hidden: true });
  const spoken = h("p", { class: "visually-hidden", "aria-live": "polite" });
  const scale = makeScale();
  const buttons = zoomButtons({ look: () => state, turnTo, fit: showAll });
  const stage = h("div", { class: "stage" }, canvas, buttons, scale.bar, tip, spoken);
  const context = canvas.getContext("2d");
  let calm = 0;

  function paint(/** @type {ReturnType<typeof paletteOf>} */ palette) {
    context.save();
    draw(context, scene, state, palette, density());
    drawMarks(context, scene, state, palette);
    drawLive(context, state, palette);
    context.restore();
    scale.show(state.view);
    showTip();
  }

  function showTip() {
    const place = state.focus?.kind === "cell" ? { xy_m: state.focus.xy_m } : focusPlace(scene, state);
    tip.hidden = !state.focus || !place;
    if (!state.focus || !place) return;
    const { name: title, line } = tell(scene, state, state.focus);
    tip.replaceChildren(h("strong", null, title), h("span", null, line));
    const [x, y] = toScreen(state.view, state.size, place.xy_m);
    const left = Math.min(Math.max(x - tip.offsetWidth / 2, 8), Math.max(state.size.width - tip.offsetWidth - 8, 8));
    const above = y - tip.offsetHeight - 16;
    tip.style.translate = `${left}px ${above < 8 ? y + 18 : above}px`;
  }

  function setFocus(/** @type {import("./scene.js").Focus | null} */ focus, spokenToo = false) {
    state.focus = focus;
    if (focus && spokenToo) {
      const { name: title, line } = tell(scene, state, focus);
      spoken.textContent = `${title}, ${line}`;
    }
    redraw();
  }

  function turnTo(/** @type {import("../../shared/map/projection.js").View} */ view) {
    state.view = view;
    state.hurried = scene.index.points.length > MANY_FOOTSTEPS;
    clearTimeout(calm);
    calm = setTimeout(() => {
      state.hurried = false;
      redraw();
    }, CALM_MS);
    redraw();
  }

  function showAll() {
    const { plan, layers } = state;
    const planned = plan && layers.plan ? boundsOf(corners(plan.placement, plan.aspect)) : null;
    turnTo(fit(/** @type {any} */ (around(scene.drawn_m, planned)), state.size));
  }

  onGestures(canvas, {
    look: () => state,
    turnTo,
    fit: showAll,
    leave: () => setFocus(null),
    point(at_px, reach_px) {
      if (state.tie || state.naming) return;
      const reach_m = reach_px / state.view.px_per_m;
      setFocus(focusAt(scene, state, toMap(state.view, state.size, at_px), reach_m));
    },
    tap(at_px) {
      if (!state.tie && !state.naming) return;
      state.focus = null;
      told.onTap(toMap(state.view, state.size, at_px));
    },
    step(by) {
      setFocus(nextFocus(scene, state, by), true);
      const place = focusPlace(scene, state);
      if (place && isOutside(toScreen(state.view, state.size, place.xy_m), state.size)) {
        turnTo({ ...state.view, x_m: place.xy_m[0], y_m: place.xy_m[1] });
      }
    },
    grab(at_px, reach_px) {
      const drag = grabPlan(state, at_px, reach_px);
      return drag && ((to_px) => told.onPlacement(drag(to_px), false));
    },
    drop: () => state.plan && told.onPlacement(state.plan.placement, true),
  });

  let first = true;
  const { redraw, leave: unmount } = mountSurface(canvas, {
    paletteOf, paint,
    resized(size) {
      state.size = size;
      if (first) state.view = fit(scene.drawn_m, size);
      first = false;
    },
  });
  const leave = () => {
    unmount();
    clearTimeout(calm);
  };
  return { stage, canvas, redraw, showAll, leave, setFocus };
}

/** @param {import("../../shared/map/projection.js").Point} at_px @param {import("../../shared/map/projection.js").Size} size */
function isOutside([x, y], { width, height }) {
  return x < 0 || y < 0 || x > width || y > height;
}

// Dragging a floor plan into place: its corners stretch it, its knob turns it, the rest moves it.

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("../../shared/map/placement.js").Placement} Placement */

/**
 * What a drag that begins here does to the plan: each later place of the finger gives a placement.
 * @param {State} state @param {Point} at_px @param {number} reach_px
 * @returns {((to_px: Point) => Placement) | null} null where it would move the map instead
 */
export function grabPlan(state, at_px, reach_px) {
  const { plan, view, size } = state;
  if (!plan || !state.placing) return null;
  const { placement, aspect } = plan;
  const start_m = toMap(view, size, at_px);
  const reach = Math.max(reach_px, HANDLE_PX);
  const near = (/** @type {Point} */ [x, y]) => Math.hypot(x - at_px[0], y - at_px[1]) <= reach;
  const handles = handlesOf(state);
  const here = (/** @type {Point} */ to_px) => toMap(view, size, to_px);
  if (near(handles.knob)) return (to_px) => turned(placement, aspect, headingOf(placement, aspect, start_m, here(to_px)));
  const corner = handles.corners.findIndex(near);
  if (corner >= 0) {
    const off = offset(corners(placement, aspect)[corner], start_m);
    return (to_px) => stretched(placement, aspect, corner, plus(here(to_px), off));
  }
  if (!isOnPlan(placement, aspect, start_m)) return null;
  return (to_px) => moved(placement, offset(here(to_px), start_m));
}

/** The heading after a finger went round the middle from one place to another. @param {Placement} placement
 * @param {number} aspect @param {Point} from_m @param {Point} to_m */
function headingOf(placement, aspect, from_m, to_m) {
  const [cx, cy] = middle(placement, aspect);
  const angle = (/** @type {Point} */ [x, y]) => Math.atan2(y - cy, x - cx);
  return snapped(placement.heading_rad + angle(to_m) - angle(from_m));
}

/** Plans mostly lie square: within a degree of it they are put square. @param {number} heading_rad */
export function snapped(heading_rad) {
  const quarter = Math.PI / 2;
  const square = Math.round(heading_rad / quarter) * quarter;
  return Math.abs(heading_rad - square) < Math.PI / 180 ? square : heading_rad;
}

/** @param {Point} to @param {Point} from @returns {Point} */
function offset(to, from) {
  return [to[0] - from[0], to[1] - from[1]];
}

/** @param {Point} one @param {Point} other @returns {Point} */
function plus(one, other) {
  return [one[0] + other[0], one[1] + other[1]];
}

// What is under the finger, in words. Pure.

/** @typedef {import("./scene.js").Focus} Focus */

/** The footstep, fix or square at a place; null where there is nothing.
 * @param {Scene} scene @param {State} state @param {Point} xy_m @param {number} reach_m
 * @returns {Focus | null} */
export function focusAt(scene, state, xy_m, reach_m) {
  const fix = state.layers.fixes ? nearestFix(state, xy_m, reach_m) : null;
  if (fix) return fix;
  const seen = (/** @type {number} */ row) => !state.hidden.has(stepAt(scene, row).walk);
  const row = state.layers.trajectories ? nearest(scene.index, xy_m, reach_m, seen) : null;
  if (row !== null) return { kind: "step", ...stepAt(scene, row) };
  if (state.layers.coverage && scene.coverage && cellAt(scene.coverage, xy_m)) return { kind: "cell", xy_m };
  return null;
}

/** @param {State} state @param {Point} xy_m @param {number} reach_m @returns {Focus | null} */
function nearestFix({ located }, [x, y], reach_m) {
  /** @type {Focus | null} */
  let best = null;
  let best_m = reach_m;
  located.forEach((walk, at) => {
    if (!walk.shown) return;
    walk.fixes.forEach(({ xy_m }, fix) => {
      const away_m = xy_m ? Math.hypot(xy_m[0] - x, xy_m[1] - y) : Infinity;
      if (away_m <= best_m) [best, best_m] = [{ kind: "fix", located: at, fix }, away_m];
    });
  });
  return best;
}

/** A name and a line. @param {Scene} scene @param {State} state @param {Focus} focus
 * @returns {{name: string, line: string}} */
export function tell(scene, state, focus) {
  if (focus.kind === "step") return tellStep(scene.walks[focus.walk], focus.step);
  if (focus.kind === "fix") return tellFix(state.located[focus.located], focus.fix);
  const cell = scene.coverage && cellAt(scene.coverage, focus.xy_m);
  const known = cell?.sigma_m ?? null;
  return {
    name: counted(cell?.walks ?? 0, "{{count}} walk here", "{{count}} walks here"),
    line: known === null ? t("uncertainty unknown") : t("places are known to ± {{distance}}", { distance: formatMetres(known) }),
  };
}

/** @param {import("./scene.js").Walk} walk @param {number} step */
function tellStep(walk, step) {
  const sigma_m = walk.sigma_m?.[step] ?? null;
  const parts = [t("footstep {{number}}", { number: step + 1 }), placeWords(walk.xy_m[step])];
  if (walk.t_s[step] !== undefined) parts.unshift(t("at {{time}}", { time: formatDuration(walk.t_s[step]) }));
  if (sigma_m !== null) parts.push(`± ${formatMetres(sigma_m)}`);
  return { name: walk.name, line: parts.join(" · ") };
}

/** @param {import("./scene.js").Located} located @param {number} at */
function tellFix({ name, fixes }, at) {
  const { t_s, xy_m, sigma_m, status } = fixes[at];
  const parts = [STATUS_WORDS[status] ?? status, t("at {{time}}", { time: formatDuration(t_s) })];
  if (xy_m) parts.push(placeWords(xy_m));
  if (sigma_m !== null) parts.push(`± ${formatMetres(sigma_m)}`);
  return { name, line: parts.join(" · ") };
}

/** @param {Point} xy_m */
function placeWords([x_m, y_m]) {
  return t("x {{x}}, y {{y}} m", { x: formatNumber(x_m, 2), y: formatNumber(y_m, 2) });
}

/** The footstep before or after the one in focus, over all walks that are shown.
 * @param {Scene} scene @param {State} state @param {number} by @returns {Focus | null} */
export function nextFocus(scene, state, by) {
  const shown = scene.walks.map((_, at) => at).filter((at) => !state.hidden.has(at));
  const rows = shown.flatMap((walk) => scene.walks[walk].xy_m.map((_, step) => ({ walk, step })));
  if (rows.length === 0) return null;
  const { focus } = state;
  const now = focus?.kind === "step" ? rows.findIndex((r) => r.walk === focus.walk && r.step === focus.step) : -1;
  const next = now < 0 ? (by > 0 ? 0 : rows.length - 1) : (now + by + rows.length) % rows.length;
  return { kind: "step", ...rows[next] };
}

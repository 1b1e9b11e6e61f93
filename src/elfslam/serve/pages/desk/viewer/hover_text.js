// What is under the finger, in words. Pure.

import { formatDuration, formatMetres, formatNumber } from "../../shared/format.js";
import { counted, t } from "../../shared/words.js";
import { cellAt, nearest, stepAt } from "./scene.js";
import { STATUS_WORDS } from "./state.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("./scene.js").Scene} Scene */
/** @typedef {import("./state.js").State} State */
/** @typedef {import("./state.js").Focus} Focus */

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

/** @param {import("./state.js").Located} located @param {number} at */
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

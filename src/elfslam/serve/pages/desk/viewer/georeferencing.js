// A floor plan scaled and placed by points: where places of it are on the walks, or how long a part of it is.
// Pure.

import { h } from "../../shared/dom.js";
import { NARROWEST_M, WIDEST_M, mapToPlan, planToMap } from "../../shared/map/placement.js";
import { t } from "../../shared/words.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {import("../../shared/map/placement.js").Placement} Placement */
/** @typedef {"points" | "length"} TieKind */
/** @typedef {{kind: TieKind, plan: Point[], map: Point[]}} Tie what was tapped so far: places of the plan, in
 * widths of it, and where those are on the map, metres
 */

const FEWEST_PAIRS = 2;
const MOST_PAIRS = 3;

/** @param {TieKind} kind @returns {Tie} */
export function noTie(kind) {
  return { kind, plan: [], map: [] };
}

/** What is to be tapped next; null where that is all. @param {Tie} tie @returns {"plan" | "map" | null} */
export function wantedNext({ kind, plan, map }) {
  if (kind === "length") return plan.length < 2 ? "plan" : null;
  if (plan.length > map.length) return "map";
  return map.length < MOST_PAIRS ? "plan" : null;
}

/** What to do now, in words. @param {Tie} tie @returns {string} */
export function askFor(tie) {
  const next = wantedNext(tie);
  if (tie.kind === "length") return next ? t("Tap one end of a known length on the plan ({{number}} of 2).", { number: tie.plan.length + 1 }) : t("How long is that?");
  if (next === "map") return t("Now tap where that is on the walk.");
  if (next === null) return t("Three places are tied; the plan lies as well as they let it.");
  return tie.map.length < FEWEST_PAIRS ? t("Tap a place on the plan, such as a corner ({{number}} of 2).", { number: tie.map.length + 1 }) : t("A third place makes it more exact, or be done.");
}

/** With one more tap. @param {Tie} tie @param {Placement} placement of the plan at this moment @param {Point} xy_m
 * @returns {Tie} */
export function tapped(tie, placement, xy_m) {
  const next = wantedNext(tie);
  if (next === "plan") return { ...tie, plan: [...tie.plan, inWidths(placement, xy_m)] };
  return next === "map" ? { ...tie, map: [...tie.map, xy_m] } : tie;
}

/** Where the tapped places of the plan lie now. @param {Tie} tie @param {Placement} placement @returns {Point[]} */
export function placesOf({ plan }, placement) {
  return plan.map(([u, v]) => planToMap(placement, [u * placement.width_m, v * placement.width_m]));
}

/** @param {Placement} placement @param {Point} xy_m @returns {Point} */
function inWidths(placement, xy_m) {
  const [u_m, v_m] = mapToPlan(placement, xy_m);
  return [u_m / placement.width_m, v_m / placement.width_m];
}

/** The placement that brings the tied places of the plan nearest to where they are (least squares of a
 * similarity); null with fewer than two, or where they are one. @param {Tie} tie @param {Placement} placement
 * @returns {Placement | null} */
export function tied({ plan, map }, placement) {
  if (map.length < FEWEST_PAIRS) return null;
  const from = plan.slice(0, map.length);
  const [pu, pv] = mean(from);
  const [mx, my] = mean(map);
  let [real, turn, spread] = [0, 0, 0];
  from.forEach(([u, v], at) => {
    const [du, dv, dx, dy] = [u - pu, v - pv, map[at][0] - mx, map[at][1] - my];
    real += du * dx + dv * dy;
    turn += du * dy - dv * dx;
    spread += du * du + dv * dv;
  });
  const width_m = Math.hypot(real, turn) / spread;
  if (!isWide(width_m)) return null;
  const heading_rad = Math.atan2(turn, real);
  const [x_m, y_m] = planToMap({ ...placement, x_m: mx, y_m: my, heading_rad }, [-pu * width_m, -pv * width_m]);
  return { ...placement, width_m, heading_rad, x_m, y_m };
}

/** The placement in which the two tapped places are so far apart; the first stays where it is. Null where they
 * are one. @param {Tie} tie @param {Placement} placement @param {number} length_m @returns {Placement | null} */
export function scaledTo(tie, placement, length_m) {
  if (tie.plan.length < 2) return null;
  const [one, other] = tie.plan;
  const width_m = length_m / Math.hypot(other[0] - one[0], other[1] - one[1]);
  if (!isWide(width_m)) return null;
  const [x_m, y_m] = placesOf(tie, placement)[0];
  const [dx, dy] = placesOf(tie, { ...placement, width_m, x_m: 0, y_m: 0 })[0];
  return { ...placement, width_m, x_m: x_m - dx, y_m: y_m - dy };
}

/** @param {number} width_m */
function isWide(width_m) {
  return Number.isFinite(width_m) && width_m >= NARROWEST_M && width_m <= WIDEST_M;
}

/** @param {Point[]} points @returns {Point} */
function mean(points) {
  return [points.reduce((sum, [x]) => sum + x, 0) / points.length, points.reduce((sum, [, y]) => sum + y, 0) / points.length];
}

// Scaling and placing a floor plan by points, step by step: two buttons in the panel, and a bar on the map.

/** @typedef {import("./state.js").State} State */

/**
 * @param {State} state @param {{place: (placement: Placement, finished: boolean) => void, redraw: () => void, changed: () => void}} told
 */
export function tiePart(state, { place, redraw, changed }) {
  const words = h("p", { role: "status" });
  const done = h("button", { type: "button", class: "button small", click: end }, t("Done"));
  const length = h("input", { type: "number", step: "0.01", min: "0.1", name: "plan-length", inputmode: "decimal" });
  const form = h("form", { class: "row" }, h("label", { class: "field" }, h("span", null, t("Length, m")), length),
    h("button", { type: "submit", class: "button" }, t("Scale it")));
  const bar = h("div", { class: "tie-bar", hidden: true }, words, form, done);
  form.addEventListener("submit", (/** @type {Event} */ event) => {
    event.preventDefault();
    const made = state.tie && state.plan && scaledTo(state.tie, state.plan.placement, length.valueAsNumber);
    if (!made) {
      words.textContent = t("These two places and this length give no plan of 0.1 to 5000 m; give another length, or begin again.");
      return;
    }
    place(made, true);
    end();
  });

  /** @param {TieKind} kind */
  function begin(kind) {
    state.tie = noTie(kind);
    state.placing = false;
    state.naming = false;
    changed();
    bar.closest(".stage")?.scrollIntoView({ block: "nearest" });
  }

  function end() {
    state.tie = null;
    changed();
  }

  /** @param {import("../../shared/map/projection.js").Point} xy_m */
  function tap(xy_m) {
    const { tie, plan } = state;
    if (!tie || !plan) return;
    state.tie = tapped(tie, plan.placement, xy_m);
    const isPair = state.tie.kind === "points" && state.tie.map.length === state.tie.plan.length;
    const made = isPair ? tied(state.tie, plan.placement) : null;
    if (isPair && !made && state.tie.map.length >= FEWEST_PAIRS) state.tie = noTie("points");
    if (made) place(made, true);
    show();
    redraw();
  }

  function show() {
    bar.hidden = state.tie === null;
    if (!state.tie) return;
    words.textContent = askFor(state.tie);
    form.hidden = state.tie.kind !== "length" || wantedNext(state.tie) !== null;
  }

  function part() {
    show();
    const begins = (/** @type {TieKind} */ kind, /** @type {string} */ title) =>
      h("button", { type: "button", class: "button", "aria-pressed": String(state.tie?.kind === kind), click: () => begin(kind) }, title);
    return [h("div", { class: "row" }, begins("points", t("Place by points")), begins("length", t("Scale by a length")))];
  }

  return { part, tap, bar };
}

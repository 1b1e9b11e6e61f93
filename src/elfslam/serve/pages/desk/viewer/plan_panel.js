// The floor plan under the map: uploading it, its place as numbers, saving.

import { Problem, request, requestJson } from "../../shared/api.js";
import { h, icon } from "../../shared/dom.js";
import { isNegative, loadPlanImage } from "../../shared/map/ground.js";
import {
  NARROWEST_M, WIDEST_M, firstPlacement, mapToPlan, moved, planToMap, rounded, turned, widened,
} from "../../shared/map/placement.js";
import { t } from "../../shared/words.js";
import { askPerson, confirmDelete, orSay, say } from "../dialogs.js";
import { part } from "./panel.js";

/** @typedef {import("../../shared/map/placement.js").Placement} Placement */
/** @typedef {import("./scene.js").State} State */

const SAVE_AFTER_MS = 500;
const DEGREE = Math.PI / 180;

/** What plans come as, by how their files end. @type {Record<string, string>} */
const TYPES = {
  png: "image/png", jpg: "image/jpeg", jpeg: "image/jpeg", pdf: "application/pdf", svg: "image/svg+xml",
  geojson: "application/geo+json", json: "application/geo+json",
};

/** What a file says it is, by how it ends; undefined of what is no plan. @param {{name: string}} file */
export function planType({ name }) {
  return TYPES[name.toLowerCase().split(".").at(-1) ?? ""];
}

/** @type {[string, string, string, (p: Placement) => number, (p: Placement, aspect: number, value: number) => Placement][]} */
const FIELDS = [
  ["width", t("Width, m"), "0.01", (p) => p.width_m, widened],
  ["x", t("Left, m"), "0.01", (p) => p.x_m, (p, _, x) => moved(p, [x - p.x_m, 0])],
  ["y", t("Bottom, m"), "0.01", (p) => p.y_m, (p, _, y) => moved(p, [0, y - p.y_m])],
  ["turn", t("Turned, degrees"), "0.1", (p) => Number((p.heading_rad / DEGREE).toFixed(2)), (p, aspect, degrees) => turned(p, aspect, degrees * DEGREE)],
];

/** Which of several levels of a plan is meant; null where nobody chose. @param {string[]} levels @returns {Promise<string | null>} */
async function askLevel(levels) {
  const body = h("label", { class: "field" }, h("span", null, t("This plan has several levels. Which one is this map's?")),
    h("select", { name: "level" }, levels.map((level) => h("option", { value: level }, level))));
  const answer = await askPerson({ title: t("Level of the plan"), body, submit: t("Put it below the map") });
  return answer && String(answer.get("level"));
}

/** What the server keeps of where a plan lies, if it does. @param {any} kept @returns {Placement | null} */
function keptPlacement(kept) {
  return Number.isFinite(kept?.placement?.width_m) ? kept.placement : null;
}

/**
 * The floor plan of a map: its part of the panel, and its loading and saving.
 * @param {string} mapId @param {State} state @param {import("../../shared/map/projection.js").Bounds} bounds_m
 * @param {{canEdit: () => boolean, redraw: () => void, changed: () => void, showAll: () => void}} told `changed` when
 * the plan came or went
 */
export function planOf(mapId, state, bounds_m, { canEdit, redraw, changed, showAll }) {
  const path = `/api/maps/${encodeURIComponent(mapId)}/floor-plan`;
  const status = h("p", { class: "soft saved", role: "status" });
  /** @type {Map<string, HTMLInputElement>} */
  const inputs = new Map();
  let timer = 0;
  let dirty = false;
  const tie = tiePart(state, { place, redraw, changed });

  /** @param {any} kept */
  async function load(kept) {
    const picture = await loadPlanImage(`${path}?${Date.now()}`);
    state.plan = { ...picture, placement: keptPlacement(kept) ?? firstPlacement(bounds_m, picture.aspect, kept?.width_m) };
    state.layers.plan = true;
    changed();
  }

  /** @param {Placement} placement @param {boolean} finished */
  function place(placement, finished) {
    if (!state.plan) return;
    state.plan.placement = rounded(placement);
    dirty = true;
    fillIn();
    redraw();
    status.textContent = t("Not saved yet");
    clearTimeout(timer);
    if (finished) timer = setTimeout(save, SAVE_AFTER_MS);
  }

  async function save() {
    clearTimeout(timer);
    if (!dirty || !state.plan) return;
    dirty = false;
    const json = state.plan.placement;
    const well = await orSay(() => request(`${path}/placement`, { method: "PUT", json, keepalive: true }));
    dirty ||= !well;
    status.textContent = well ? t("Saved") : t("Not saved; change it again to retry");
  }

  /** @param {File} file @param {string} [level] of several @returns {Promise<any>} the map, or null where nobody chose */
  async function put(file, level) {
    const headers = { "Content-Type": planType(file) ?? "application/octet-stream" };
    const of = level === undefined ? "" : `?level=${encodeURIComponent(level)}`;
    try {
      return await requestJson(path + of, { method: "PUT", body: file, headers });
    } catch (problem) {
      if (!(problem instanceof Problem) || problem.levels.length === 0) throw problem;
      const chosen = await askLevel(problem.levels);
      return chosen === null ? null : put(file, chosen);
    }
  }

  /** @param {File} file */
  async function upload(file) {
    let map = null;
    const well = await orSay(async () => {
      map = await put(file);
      if (map) await load(map.floor_plan);
    });
    if (!well || !map || !state.plan) return;
    state.placing = true;
    state.tie = null;
    dirty = true;
    await save();
    changed();
    showAll();
    say(t("Drag the plan under the walks; its corners stretch it, the knob turns it. Or place it by points."));
  }

  async function remove() {
    if (!(await confirmDelete(t("the floor plan"), t("The image and its place are deleted. The map itself stays as it is.")))) return;
    if (!(await orSay(() => request(path, { method: "DELETE" })))) return;
    state.plan = null;
    state.tie = null;
    state.placing = false;
    dirty = false;
    changed();
  }

  function fillIn() {
    if (!state.plan) return;
    for (const [name, , , read] of FIELDS) {
      const input = inputs.get(name);
      if (input && document.activeElement !== input) input.value = String(read(state.plan.placement));
    }
    const opacity = inputs.get("opacity");
    if (opacity) opacity.value = String(state.plan.placement.opacity);
  }

  function fieldsOf() {
    const fields = FIELDS.map(([name, words, step, , write]) => {
      const input = h("input", { type: "number", step, name: `plan-${name}`, inputmode: "decimal" });
      input.addEventListener("input", () => {
        if (!state.plan || !Number.isFinite(input.valueAsNumber)) return;
        place(write(state.plan.placement, state.plan.aspect, input.valueAsNumber), true);
      });
      input.addEventListener("blur", fillIn);
      inputs.set(name, input);
      return h("label", { class: "field" }, h("span", null, words), input);
    });
    const opacity = h("input", { type: "range", min: "0.05", max: "1", step: "0.05", name: "plan-opacity" });
    opacity.addEventListener("input", () => state.plan && place({ ...state.plan.placement, opacity: opacity.valueAsNumber }, true));
    inputs.set("opacity", opacity);
    return [h("div", { class: "fields two" }, fields), h("label", { class: "field" }, h("span", null, t("Opacity")), opacity)];
  }

  function pick() {
    const input = h("input", { type: "file", accept: Object.keys(TYPES).map((ending) => `.${ending}`).join(","), class: "visually-hidden", name: "plan-file" });
    input.addEventListener("change", () => {
      const file = input.files?.[0];
      // The same file may be chosen again.
      input.value = "";
      if (file) upload(file);
    });
    return h("label", { class: "button" }, icon("image"), state.plan ? t("Another plan") : t("Choose a plan"), input);
  }

  /** Light lines on a dark ground, on this screen alone. */
  function negativeTick() {
    const negative = h("input", { type: "checkbox", name: "plan-inverted" });
    negative.checked = state.plan !== null && isNegative(state.plan);
    negative.addEventListener("change", () => {
      if (state.plan) state.plan.inverted = negative.checked;
      redraw();
    });
    return h("label", { class: "tick" }, negative, h("span", null, t("Light on dark")));
  }

  function body() {
    tie.bar.hidden = state.tie === null;
    if (!canEdit()) return state.plan ? negativeTick() : h("p", { class: "soft" }, t("None yet. Who may edit the map can put one below it."));
    if (!state.plan) return [h("p", { class: "soft" }, t("A plan of the floor (PNG, JPEG, PDF, SVG or GeoJSON) to lie under the walks.")), pick()];
    const placing = h("button", { type: "button", class: "button", "aria-pressed": String(state.placing), click: () => {
      state.placing = !state.placing;
      if (state.tie) {
        state.tie = null;
        changed();
      }
      placing.setAttribute("aria-pressed", String(state.placing));
      redraw();
    } }, icon("fit"), t("Move the plan"));
    const shown = [h("div", { class: "row" }, placing), ...tie.part(), ...fieldsOf(),
      negativeTick(), status,
      h("div", { class: "row" }, pick(), h("button", { type: "button", class: "button danger", click: remove }, icon("trash"), t("Remove")))];
    fillIn();
    return shown;
  }

  return { load, place, save, upload, tap: tie.tap, bar: tie.bar, part: () => part(t("Floor plan"), body()) };
}

// A floor plan scaled and placed by points: where places of it are on the walks, or how long a part of it is.
// Pure.

/** @typedef {import("../../shared/map/projection.js").Point} Point */
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

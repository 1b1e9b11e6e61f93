// The floor plan under the map: uploading it, its place as numbers, saving.

import { Problem, request, requestJson } from "../../shared/api.js";
import { askPerson, confirmDelete, orSay, say } from "../dialogs.js";
import { h, icon } from "../../shared/dom.js";
import { part } from "./panel.js";
import { tiePart } from "./georeferencing.js";
import { isNegative, loadPlanImage } from "../../shared/map/ground.js";
import { firstPlacement, moved, rounded, turned, widened } from "../../shared/map/placement.js";
import { t } from "../../shared/words.js";

/** @typedef {import("../../shared/map/placement.js").Placement} Placement */
/** @typedef {import("./state.js").State} State */

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

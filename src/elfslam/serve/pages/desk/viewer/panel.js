// Beside the map: which layers are on, which walks are shown, and what is known of them.

import { Problem, requestJson } from "../../shared/api.js";
import { h, icon } from "../../shared/dom.js";
import { formatDuration, formatMetres } from "../../shared/format.js";
import { KIND_WORDS } from "../../shared/map/points_of_interest.js";
import { byName } from "../../shared/places.js";
import { counted, t } from "../../shared/words.js";
import { askPerson, confirmDelete, field, orSay } from "../dialogs.js";
import { smallButton } from "../lists.js";
import { colourOf, coverageColour } from "./draw.js";
import { css, timeColour, STATUS_WORDS, countStatuses, paletteOf } from "./scene.js";

/** @typedef {import("./scene.js").State} State */
/** @typedef {import("./scene.js").Layer} Layer */
/** @typedef {import("./scene.js").Scene} Scene */

/** A part of the panel with its heading. @param {string} title @param {any} body @param {string} [id] */
export function part(title, body, id = `part-${title.toLowerCase().replace(/\W+/g, "-")}`) {
  return h("section", { class: "part", "aria-labelledby": id }, h("h2", { id }, title), body);
}

/** The layers in the order in which they lie, with why one cannot be shown.
 * @param {Scene} scene @param {State} state @returns {[Layer, string, string | null][]} */
function layersOf(scene, state) {
  const sigmas = scene.walks.some((walk) => walk.middle_sigma_m !== null);
  return [
    ["trajectories", t("Trajectories"), scene.walks.length > 0 ? null : t("this map keeps none")],
    ["uncertainty", t("Uncertainty"), sigmas ? null : t("not known for this map")],
    ["closures", t("Places passed again"), scene.closures.length > 0 ? null : t("in maps of one walk")],
    ["reckoning", t("Dead reckoning"), scene.reckoned.length > 0 ? null : t("in maps of one walk")],
    ["coverage", t("Coverage"), scene.coverage ? null : t("comes with several walks: merge maps")],
    ["fixes", t("Located walks"), state.located.length > 0 ? null : t("none yet")],
    ["points", t("Named places"), state.points.length > 0 ? null : t("none yet")],
    ["plan", t("Floor plan"), state.plan ? null : t("none yet")],
  ];
}

/** @param {Scene} scene @param {State} state @param {() => void} changed */
export function layerPart(scene, state, changed) {
  const box = (/** @type {[Layer, string, string | null]} */ [layer, words, lacks]) => {
    const input = h("input", { type: "checkbox", name: `layer-${layer}`, disabled: lacks !== null });
    input.checked = state.layers[layer] && lacks === null;
    input.addEventListener("change", () => {
      state.layers[layer] = input.checked;
      changed();
    });
    return h("label", { class: "tick" }, input, h("span", null, words, lacks && h("small", null, ` ${lacks}`)));
  };
  const body = [h("div", { class: "ticks" }, layersOf(scene, state).map(box)),
    either(t("Colour of walks"), "colour-by", [["walk", t("by walk")], ["time", t("by time")]], state.colourBy, (value) => {
      state.colourBy = /** @type {"walk" | "time"} */ (value);
      changed();
    })];
  if (scene.coverage) {
    body.push(either(t("Coverage shows"), "coverage-by", [["walks", t("walks")], ["sigma_m", t("uncertainty")]], state.coverageBy, (value) => {
      state.coverageBy = /** @type {"walks" | "sigma_m"} */ (value);
      state.layers.coverage = true;
      changed();
    }));
  }
  return part(t("Layers"), body);
}

/** One of two or three. @param {string} legend @param {string} name @param {[string, string][]} choices
 * @param {string} chosen @param {(value: string) => void} choose */
function either(legend, name, choices, chosen, choose) {
  return h("fieldset", { class: "either" }, h("legend", null, legend), h("div", null, choices.map(([value, words]) => {
    const input = h("input", { type: "radio", name, value });
    input.checked = value === chosen;
    input.addEventListener("change", () => choose(value));
    return h("label", null, input, h("span", null, words));
  })));
}

/** @param {Scene} scene @param {State} state @param {() => void} changed */
export function walkPart(scene, state, changed) {
  const palette = paletteOf();
  const row = (/** @type {import("./scene.js").Walk} */ walk, /** @type {number} */ at) => {
    const input = h("input", { type: "checkbox", "aria-label": t("Show {{name}}", { name: walk.name }) });
    input.checked = !state.hidden.has(at);
    input.addEventListener("change", () => {
      if (input.checked) state.hidden.delete(at);
      else state.hidden.add(at);
      changed();
    });
    const line = h("tr", null, h("td", null, input),
      h("th", { scope: "row" }, h("i", { class: "swatch", style: { background: colourOf(palette, at) } }), h("span", null, walk.name),
        h("small", null, `${formatMetres(walk.length_m)} · ${formatDuration(walk.duration_s)}`)),
      h("td", null, walk.middle_sigma_m === null ? "–" : `± ${formatMetres(walk.middle_sigma_m)}`));
    const stand = (/** @type {number | null} */ chosen) => () => {
      state.chosen = scene.walks.length > 1 ? chosen : null;
      changed();
    };
    line.addEventListener("pointerenter", stand(at));
    line.addEventListener("pointerleave", stand(null));
    return line;
  };
  const head = h("tr", null, h("td", null, h("span", { class: "visually-hidden" }, t("Shown"))),
    [t("Walk"), t("Uncertainty", { context: "column" })].map((name) => h("th", { scope: "col" }, name)));
  return part(counted(scene.walks.length, "{{count}} walk", "{{count}} walks"), h("div", { class: "scroll" },
    h("table", { class: "walks", "aria-label": t("Walks") }, h("thead", null, head), h("tbody", null, scene.walks.map(row)))), "part-walks");
}

/** @param {State} state @param {() => void} changed @param {any} locate the button that locates another */
export function locatedPart(state, changed, locate) {
  const list = state.located.map((walk) => {
    const input = h("input", { type: "checkbox" });
    input.checked = walk.shown;
    input.addEventListener("change", () => {
      walk.shown = input.checked;
      changed();
    });
    const counts = countStatuses(walk.fixes).map(([status, count]) => `${count} ${STATUS_WORDS[status] ?? status}`);
    return h("label", { class: "tick" }, input, h("span", null, walk.name, h("small", null, ` ${counts.join(", ") || t("no fixes")}`)));
  });
  const none = h("p", { class: "soft" }, t("Take a recording made elsewhere on this floor and see where its walker was."));
  return part(t("Located walks"), [list.length > 0 ? h("div", { class: "ticks" }, list) : none, locate]);
}

// What the colours and marks of the map mean.

/** Only what is on and needs words. @param {Scene} scene @param {State} state */
export function legendOf(scene, state) {
  const palette = paletteOf();
  const lines = [];
  if (state.layers.coverage && scene.coverage) lines.push(coverageLegend(scene, state.coverageBy));
  if (state.layers.trajectories && state.colourBy === "time") lines.push(timeLegend(scene, palette.dark));
  if (state.layers.fixes && state.located.some((walk) => walk.shown)) lines.push(fixLegend(state));
  if (state.layers.closures && scene.closures.length > 0) lines.push(sampleLine("closure", t("places passed again")));
  if (state.layers.reckoning && scene.reckoned.length > 0) lines.push(sampleLine("reckoned", t("dead reckoning")));
  return h("div", { class: "legend", hidden: lines.length === 0, role: "group", "aria-label": t("Legend") }, lines);
}

/** @param {Scene} scene @param {"walks" | "sigma_m"} what */
function coverageLegend(scene, what) {
  const between = scene.limits[what];
  if (!between) return h("p", null, what === "walks" ? t("No walks counted") : t("Uncertainty unknown"));
  const { low, high } = between;
  if (what === "walks") return countLegend(low, high);
  const stops = Array.from({ length: 9 }, (_, k) => css(coverageColour(low + ((high - low) * k) / 8, between, what)));
  return ramp(t("uncertainty per square"), stops, formatMetres(low), formatMetres(high));
}

/** Counts are whole: a patch for each, up to six of them. @param {number} low @param {number} high */
function countLegend(low, high) {
  const step = Math.max(1, Math.ceil((high - low) / 5));
  const counts = [];
  for (let count = low; count <= high; count += step) counts.push(count);
  return h("div", { class: "ramp" }, h("span", null, t("walks per square")),
    h("ul", { class: "patches" }, counts.map((count) => h("li", null,
      h("i", { style: { background: css(coverageColour(count, { low, high }, "walks")) } }), String(Math.round(count))))));
}

/** @param {Scene} scene @param {boolean} dark */
function timeLegend(scene, dark) {
  const longest_s = scene.walks.reduce((most, walk) => Math.max(most, walk.duration_s), 0);
  const stops = Array.from({ length: 9 }, (_, k) => css(timeColour(k / 8, dark)));
  const many = scene.walks.length > 1;
  return ramp(many ? t("time of each walk") : t("time"), stops, many ? t("start") : "0:00", many ? t("end") : formatDuration(longest_s));
}

/** @param {string} name @param {string[]} stops @param {string} low @param {string} high */
function ramp(name, stops, low, high) {
  return h("div", { class: "ramp" }, h("span", null, name),
    h("i", { style: { background: `linear-gradient(to right, ${stops.join(", ")})` } }),
    h("small", null, h("span", null, low), h("span", null, high)));
}

/** @param {State} state */
function fixLegend(state) {
  const seen = new Set(state.located.filter((w) => w.shown).flatMap((w) => w.fixes.filter((f) => f.xy_m).map((f) => f.status)));
  return h("ul", { class: "samples" }, [...seen].map((status) =>
    h("li", null, h("i", { class: `fix ${status}` }), STATUS_WORDS[status] ?? status)));
}

/** @param {string} kind @param {string} words */
function sampleLine(kind, words) {
  return h("ul", { class: "samples" }, h("li", null, h("i", { class: `sample ${kind}` }), words));
}

// The rooms, doors and other places of a map that have a name: their list beside it, and how one is named, moved or
// forgotten.

/** @typedef {import("../../shared/map/points_of_interest.js").PointOfInterest} PointOfInterest */
/** @typedef {import("../../shared/map/projection.js").Point} Point */

const MOST_CHARACTERS = "80";
const CHANGED_MEANWHILE = 409;

/**
 * @param {string} mapId @param {State} state
 * @param {{canEdit: () => boolean, redraw: () => void, changed: () => void}} told `changed` when the list is another
 */
export function pointsOf(mapId, state, { canEdit, redraw, changed }) {
  const path = `/api/maps/${encodeURIComponent(mapId)}/points-of-interest`;
  let version = "";
  /** @type {HTMLElement | null} */
  let nameButton = null;
  const bar = h("div", { class: "tie-bar", hidden: true }, h("p", { role: "status" }, t("Tap the place on the map.")),
    h("button", { type: "button", class: "button small", click: () => tap([state.view.x_m, state.view.y_m]) }, t("Type where it is")),
    h("button", { type: "button", class: "button small", click: () => turn(false) }, t("Cancel")));

  async function load() {
    take(await requestJson(path));
  }

  /** @param {{version: string, points: PointOfInterest[]}} now */
  function take(now) {
    version = now.version;
    state.points = now.points;
    changed();
  }

  /** @param {PointOfInterest[]} points */
  const save = (points) => orSay(async () => {
    try {
      take(await requestJson(path, { method: "PUT", json: { version, points } }));
    } catch (problem) {
      if (problem instanceof Problem && problem.status === CHANGED_MEANWHILE) await load();
      throw problem;
    }
  });

  /** Whether the next tap on the map names a place. @param {boolean} naming */
  function turn(naming) {
    state.naming = naming;
    if (naming) {
      state.layers.points = true;
      state.tie = null;
      state.placing = false;
    }
    changed();
    if (naming) bar.closest(".stage")?.scrollIntoView({ block: "nearest" });
  }

  /** @param {Point} xy_m */
  async function tap([x_m, y_m]) {
    turn(false);
    const made = await askPlace(t("Name this place"), { name: "", kind: "room", x_m, y_m });
    if (made) await save([...state.points, made]);
    nameButton?.focus(); // the list was made anew, and the button with it
  }

  /** @param {PointOfInterest} point */
  async function edit(point) {
    const made = await askPlace(t("Change {{name}}", { name: point.name }), point);
    if (made) await save(state.points.map((each) => (each === point ? made : each)));
  }

  /** @param {PointOfInterest} point */
  async function remove(point) {
    if (!(await confirmDelete(point.name, t("The name leaves this map; walks and recordings stay.")))) return;
    await save(state.points.filter((each) => each !== point));
  }

  /** @param {PointOfInterest} point */
  function row(point) {
    const { name, kind } = point;
    const line = h("li", null, h("span", null, name, h("small", null, ` ${KIND_WORDS[kind]}`)),
      canEdit() && [smallButton("edit", t("Change {{name}}", { name }), () => edit(point)), smallButton("trash", t("Delete {{name}}", { name }), () => remove(point), "danger")]);
    const stand = (/** @type {PointOfInterest | null} */ chosen) => () => {
      state.point = chosen;
      redraw();
    };
    line.addEventListener("pointerenter", stand(point));
    line.addEventListener("pointerleave", stand(null));
    return line;
  }

  function body() {
    bar.hidden = !state.naming;
    const sorted = [...state.points].sort((one, other) => byName(one.name, other.name));
    nameButton = h("button", { type: "button", class: "button", click: () => turn(true) }, icon("plus"), t("Name a place"));
    return [sorted.length > 0 ? h("ul", { class: "points" }, sorted.map(row)) : h("p", { class: "soft" }, t("Rooms, doors and lifts get a name here: phones tell how far it is to them, and exports carry them.")),
      canEdit() && h("div", { class: "row" }, nameButton)];
  }

  return { load, tap, bar, part: () => part(t("Named places"), body(), "part-points") };
}

/** @param {string} title @param {PointOfInterest} point @returns {Promise<PointOfInterest | null>} */
async function askPlace(title, { name, kind, x_m, y_m }) {
  const metres = (/** @type {string} */ words, /** @type {string} */ axis, /** @type {number} */ value) =>
    field(words, { name: axis, type: "number", step: "0.01", value: value.toFixed(2), inputmode: "decimal", required: true });
  const kinds = Object.entries(KIND_WORDS).map(([value, words]) => h("option", { value, selected: value === kind }, words));
  const answer = await askPerson({
    title,
    body: [field(t("Name"), { name: "name", value: name, maxlength: MOST_CHARACTERS, required: true, autocomplete: "off" }),
      h("label", { class: "field" }, h("span", null, t("Kind")), h("select", { name: "kind" }, kinds)),
      h("div", { class: "fields two" }, metres(t("x, m"), "x_m", x_m), metres(t("y, m"), "y_m", y_m))],
    submit: t("Save"),
  });
  const told = (/** @type {string} */ what) => String(answer?.get(what) ?? "").trim();
  return answer && { name: told("name"), kind: /** @type {any} */ (told("kind")), x_m: Number(told("x_m")), y_m: Number(told("y_m")) };
}

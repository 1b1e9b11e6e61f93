// What the colours and marks of the map mean.

import { h } from "../../shared/dom.js";
import { formatDuration, formatMetres } from "../../shared/format.js";
import { css, timeColour } from "./colours.js";
import { STATUS_WORDS } from "./fixes.js";
import { coverageColour } from "./paths.js";
import { paletteOf } from "./state.js";
import { t } from "../../shared/words.js";

/** @typedef {import("./state.js").State} State */
/** @typedef {import("./scene.js").Scene} Scene */

/** Only what is on and needs words. @param {Scene} scene @param {State} state */
export function legendOf(scene, state) {
  const palette = paletteOf(document.documentElement);
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

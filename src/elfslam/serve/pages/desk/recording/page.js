// One recording: what was recorded, the curves of its sensors, and its files to be taken away.

import { requestJson } from "../../shared/api.js";
import { h, icon } from "../../shared/dom.js";
import { fileName, formatBytes, formatCount, formatDuration, formatWhen } from "../../shared/format.js";
import { bytesOf, deleteRecording, mapRecording, stateOf } from "../recordings_view.js";
import { spanOf } from "./curves.js";
import { plotOf } from "./plot.js";
import { factsOf, filesOf } from "./words.js";
import { t } from "../../shared/words.js";

/** @typedef {import("../main.js").Desk} Desk */
/** @typedef {import("../store.js").Recording} Recording */
/** @typedef {import("./words.js").Look} Look */
/** @typedef {import("../main.js").Opened} Opened */

/**
 * The page of a recording, in `root`; null where nobody wants it any more once it has come. Throws Problem
 * where there is no such recording.
 * @param {Desk} desk @param {string} id @param {HTMLElement} root @param {() => boolean} isWanted
 * @returns {Promise<Opened | null>}
 */
export async function openRecording(desk, id, root, isWanted) {
  const path = `/api/recordings/${encodeURIComponent(id)}`;
  const recording = /** @type {Recording} */ (await requestJson(path));
  if (!isWanted()) return null;
  const state = h("div", { class: "recording-state" });
  const facts = h("dl", { class: "facts" });
  const curves = h("div", { class: "plots", "aria-busy": "true" }, h("p", { class: "soft" }, t("Reading the sensors…")));
  const changed = () => {
    const now = desk.known.recordings.find((each) => each.id === id) ?? recording;
    state.replaceChildren(...[stateOf(now, desk.known)].flat(Infinity).filter(Boolean));
  };
  fillFacts(facts, recording, null);
  // What changes a recording, such as cutting its ends off, has its part between these two.
  const parts = [partOf(t("Sensors"), curves), filesPart(recording, path)];
  root.replaceChildren(h("div", { class: "page recording" }, headOf(desk, recording), state, facts, recording.files.length > 0 && parts));
  changed();
  if (recording.files.length > 0 && recording.state !== "receiving") void showSensors(recording, path, facts, curves);
  return { changed, receive: () => false, leave: () => {} };
}

/** @param {string} title @param {...any} body */
function partOf(title, ...body) {
  return h("section", { class: "card" }, h("h2", null, title), body);
}

/** @param {Desk} desk @param {Recording} recording */
function headOf(desk, recording) {
  const { id, name, device, created_utc } = recording;
  const ready = recording.state === "ready";
  const address = `/api/recordings/${encodeURIComponent(id)}/recording.zip`;
  return h("header", { class: "page-head" },
    h("a", { class: "button icon", href: "#/recordings", "aria-label": t("Back to the recordings"), title: t("Back to the recordings") }, icon("back")),
    h("div", null, h("h1", { tabindex: "-1" }, name), h("p", { class: "soft" }, `${device} · ${formatWhen(created_utc)}`)),
    h("div", { class: "row" },
      ready && h("button", { type: "button", class: "button primary", click: () => void mapRecording(desk, recording) }, icon("map"), t("Map", { context: "verb" })),
      ready && h("a", { class: "button", href: address, download: `${fileName(name)}.zip` }, icon("download"), t("Download")),
      h("button", { type: "button", class: "button icon danger", "aria-label": t("Delete {{name}}", { name }), title: t("Delete"), click: async () => {
        if (await deleteRecording(desk, recording)) location.hash = "#/recordings";
      } }, icon("trash"))));
}

/** @param {HTMLElement} place @param {Recording} recording @param {Look | null} look */
function fillFacts(place, recording, look) {
  const shared = { duration: formatDuration(recording.facts?.duration_s), bytes: formatBytes(bytesOf(recording)), count: formatCount };
  place.replaceChildren(...factsOf(recording, look, shared).map(([name, value]) => h("div", null, h("dt", null, name), h("dd", null, value))));
}

/** @param {Recording} recording @param {string} path @param {HTMLElement} facts @param {HTMLElement} curves */
async function showSensors(recording, path, facts, curves) {
  try {
    const look = /** @type {Look} */ (await requestJson(`${path}/sensors`));
    fillFacts(facts, recording, look);
    const span = spanOf(look.curves);
    const plots = look.curves.map((curve) => plotOf(curve, span)).filter(Boolean);
    curves.replaceChildren(...(plots.length > 0 ? plots : [h("p", { class: "soft" }, t("No sensor of it can be drawn."))]));
  } catch (problem) {
    curves.replaceChildren(h("p", { class: "problem" }, problem instanceof Error ? problem.message : String(problem)));
  }
  curves.removeAttribute("aria-busy");
}

/** @param {Recording} recording @param {string} path */
function filesPart(recording, path) {
  const lines = filesOf(recording.files).map(({ name, size_bytes, words }) => h("li", null,
    h("a", { class: "button small", href: `${path}/files/${encodeURIComponent(name)}`, download: `${fileName(recording.name)}-${name}`, "aria-label": t("Download {{name}}", { name }) }, icon("download"), name),
    h("div", null, h("span", null, words), h("span", null, formatBytes(size_bytes)))));
  return partOf(t("Files"), h("ul", { class: "exports" }, lines));
}

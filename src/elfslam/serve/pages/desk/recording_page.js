// One recording: what was recorded, the curves of its sensors, and its files to be taken away.

import { requestJson } from "../shared/api.js";
import { h, icon, svg } from "../shared/dom.js";
import { fileName, formatBytes, formatCount, formatDuration, formatWhen } from "../shared/format.js";
import { locale, t } from "../shared/words.js";
import { bytesOf, deleteRecording, mapRecording, stateOf } from "./recordings_view.js";

/** @typedef {import("./main.js").Desk} Desk */
/** @typedef {import("./store.js").Recording} Recording */

/** @typedef {import("./main.js").Opened} Opened */

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
    state.replaceChildren(...[stateOf(now, desk.known, desk.nowMs())].flat(Infinity).filter(Boolean));
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

// One curve as a drawing that stretches with the page, with what is under the finger told above it.

const BOX = { width: 800, height: 120 };
const TIMES = [0, 0.25, 0.5, 0.75, 1];

/** @param {Curve} curve @param {Span} span that all curves of a page share */
function plotOf(curve, span) {
  const extent = extentOf(curve);
  if (extent === null) return null;
  const told = h("output", { class: "soft" }, `${curve.unit}`);
  const mark = h("i", { class: "plot-mark", hidden: true });
  const ticks = ticksOf(extent);
  const percent = (/** @type {number} */ value) => `${(shareDown(extent, value) * 100).toFixed(2)}%`;
  const lines = ticks.map((tick) => svg("line", { x1: 0, x2: BOX.width, y1: percent(tick), y2: percent(tick), class: "plot-grid" }));
  const drawing = svg("svg", { viewBox: `0 0 ${BOX.width} ${BOX.height}`, preserveAspectRatio: "none", role: "img", "aria-label": summaryOf(curve) },
    lines, svg("path", { d: pathOf(curve, extent, span, BOX), class: isCounted(curve) ? "plot-bars" : "plot-band" }));
  const labels = ticks.map((tick) => h("span", { style: { top: percent(tick) } }, tickText(tick)));
  const area = h("div", { class: "plot-area" }, drawing, mark);
  follow(area, mark, told, curve, span);
  return h("figure", { class: "plot" },
    h("figcaption", null, h("strong", null, titleOf(curve)), told),
    h("div", { class: "plot-scale", "aria-hidden": "true" }, labels), area,
    h("div", { class: "plot-times", "aria-hidden": "true" }, TIMES.map((share) => h("span", null, formatDuration(timeAt(span, share))))));
}

/** Tell what is under the finger or the mouse. @param {HTMLElement} area @param {HTMLElement} mark
 * @param {HTMLOutputElement} told @param {Curve} curve @param {Span} span */
function follow(area, mark, told, curve, span) {
  area.addEventListener("pointermove", (event) => {
    const { left, width } = area.getBoundingClientRect();
    const share = Math.min(1, Math.max(0, (event.clientX - left) / width));
    mark.hidden = false;
    mark.style.setProperty("left", `${share * 100}%`);
    const t_s = timeAt(span, share);
    told.textContent = `${formatDuration(t_s)}: ${readingText(curve, stretchAt(curve, t_s))}`;
  });
  area.addEventListener("pointerleave", () => {
    mark.hidden = true;
    told.textContent = curve.unit;
  });
}

// What is told of a recording, and what each of its files holds. Pure.

/** @typedef {{sensors: {name: string, readings: number, rate_hz: number | null}[], curves: Curve[], chirps_played: number | null, chirps_heard_share: number | null}} Look */

/** Sensors as people call them. @type {Record<string, string>} */
const SENSORS = {
  audio: t("Sound"),
  imu: t("Motion"),
  orientation: t("Attitude"),
  odometry: t("Odometry"),
  magnetometer: t("Magnetic field"),
  barometer: t("Air pressure"),
  wifi: t("Wi-Fi scans"),
  emr: t("Mains hum"),
};

/** Programs whose recordings are taken in. @type {Record<string, string>} */
const PROGRAMS = {
  mall: "Indoor Location Competition",
  magnetic: t("Magnetic walks (.mat)"),
  sensorlogger: "Sensor Logger",
  phyphox: "phyphox",
  getsensordata: "GetSensorData",
  ronin: "RoNIN",
};

/** What a file of a recording holds. @type {Record<string, string>} */
const FILES = {
  "accelerometer.csv": t("Acceleration with gravity, m/s²"),
  "gyroscope.csv": t("Turn rates, rad/s"),
  "magnetometer.csv": t("Magnetic field, µT"),
  "barometer.csv": t("Air pressure, hPa"),
  "orientation.csv": t("Attitude as quaternions"),
  "wifi.csv": t("Access points seen, dBm"),
  "emr.csv": t("Harmonics of the mains"),
  "chirps.csv": t("When chirps were played"),
  "audio.flac": t("Sound"),
  "audio.wav": t("Sound"),
  "frames.flac": t("Sound around each chirp"),
  "frames.wav": t("Sound around each chirp"),
  "frames.csv": t("When each piece of sound begins"),
  "baseband.iq": t("The chirp band alone"),
  "baseband.csv": t("When each piece of sound begins"),
  "odometry.tum": t("The device's own odometry"),
  "odometry_sigma.csv": t("How far that can be trusted"),
  "truth.tum": t("Where the walk is known to have been"),
  "waypoints.csv": t("Places that were passed"),
  "recording.json": t("Name, device, chirp"),
};

/** Name and value of what is told, in order. @param {Recording} recording @param {Look | null} look null
 * until the server has read the sensors
 * @param {{duration: string, bytes: string, count: (count: number) => string}} shared
 * @returns {[string, string][]} */
export function factsOf({ facts }, look, { duration, bytes, count }) {
  /** @type {[string, string | null][]} */
  const told = [
    [t("Duration"), duration],
    [t("Footsteps"), Number.isFinite(facts?.footsteps) ? count(facts.footsteps) : null],
    [t("Size"), bytes],
    [t("Recorded with"), facts?.imported ? (PROGRAMS[facts.imported] ?? String(facts.imported)) : null],
    [t("Damaged lines left out"), facts?.damaged_lines > 0 ? count(facts.damaged_lines) : null],
    [t("Noted when it was read"), facts?.notes?.length ? facts.notes.join("; ") : null],
    [t("Chirps played"), look?.chirps_played ? count(look.chirps_played) : null],
    [t("Chirps heard"), heardText(look?.chirps_heard_share ?? null)],
    ...rates(facts, look),
  ];
  return told.flatMap(([name, value]) => (value === null ? [] : [[name, value]]));
}

/** @param {number | null} share of the chirps that were due, 0 to 1; null without sound */
function heardText(share) {
  if (share === null) return null;
  return share === 0 ? t("none") : `${Math.floor(share * 100)} %`;
}

/** @param {any} facts @param {Look | null} look @returns {[string, string][]} */
function rates(facts, look) {
  if (look === null) return (facts?.sensors ?? []).map((/** @type {string} */ name) => [SENSORS[name] ?? name, "…"]);
  return look.sensors.map(({ name, readings, rate_hz }) => [SENSORS[name] ?? name, name === "wifi" || rate_hz === null ? String(readings) : rateText(rate_hz)]);
}

/** @param {number} rate_hz @returns {string} 48 kHz, 44.1 kHz, 100 Hz, 0.8 Hz */
export function rateText(rate_hz) {
  if (rate_hz >= 1000) return `${shortly(Number((rate_hz / 1000).toFixed(1)))} kHz`;
  return `${shortly(rate_hz >= 10 ? Math.round(rate_hz) : Number(rate_hz.toPrecision(2)))} Hz`;
}

/** With no more digits than it has. @param {number} value */
function shortly(value) {
  return value.toLocaleString(locale, { useGrouping: false });
}

/** Files to be taken away, tables first. @template {{name: string, size_bytes: number}} T @param {T[]} files
 * @returns {(T & {words: string})[]} */
export function filesOf(files) {
  const rank = (/** @type {string} */ name) => (name.endsWith(".csv") ? 0 : 1);
  return [...files].sort((a, b) => rank(a.name) - rank(b.name) || a.name.localeCompare(b.name))
    .map((file) => ({ ...file, words: FILES[file.name] ?? "" }));
}

// Curves of least and largest values, as paths in a box and as words. Pure.

/** @typedef {{name: string, unit: string, start_s: number, step_s: number, low: (number | null)[], high: (number | null)[]}} Curve */
/** @typedef {{low: number, high: number}} Extent */
/** @typedef {{start_s: number, end_s: number}} Span */
/** @typedef {{width: number, height: number}} Box */

/** What the server calls a curve, and what people do. @type {Record<string, string>} */
const NAMES = {
  acceleration: t("Acceleration"),
  "yaw rate": t("Turning"),
  "magnetic field": t("Magnetic field"),
  "air pressure": t("Air pressure"),
  "access points": t("Wi-Fi access points"),
  "sound level": t("Sound level"),
};

/** Counted one by one: bars from zero, where others are bands. */
const COUNTED = ["access points"];

/** @param {Curve} curve */
export function titleOf({ name }) {
  return NAMES[name] ?? name;
}

/** @param {Curve} curve */
function isCounted({ name }) {
  return COUNTED.includes(name);
}

/** From the least to the largest, never without height. @param {Curve} curve @returns {Extent | null} */
export function extentOf(curve) {
  const known = [...curve.low, ...curve.high].filter((value) => value !== null);
  if (known.length === 0) return null;
  const low = isCounted(curve) ? 0 : known.reduce((a, b) => Math.min(a, b));
  const high = known.reduce((a, b) => Math.max(a, b));
  const least = Math.max(1e-9, Math.abs(high) * 1e-3);
  return high - low >= least ? { low, high } : { low: low - least, high: high + least };
}

/** Round numbers within an extent, two to five. @param {Extent} extent @returns {number[]} */
export function ticksOf({ low, high }) {
  const rough = (high - low) / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((each) => each * power >= rough) ?? 10);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k += 1) ticks.push(Number((k * step).toPrecision(12)));
  return ticks;
}

/** A number as a tick says it. @param {number} value @returns {string} */
export function tickText(value) {
  return Number(value.toPrecision(4)).toLocaleString(locale, { maximumSignificantDigits: 4, useGrouping: false }).replace("-", "−");
}

/** How far down a value lies, 0 at the top. @param {Extent} extent @param {number} value */
export function shareDown({ low, high }, value) {
  return (high - value) / (high - low);
}

/** Stretches in a row that were read: first and last of each. @param {(number | null)[]} values
 * @returns {[number, number][]} */
export function runsOf(values) {
  /** @type {[number, number][]} */
  const runs = [];
  values.forEach((value, at) => {
    if (value === null) return;
    const last = runs.at(-1);
    if (last && last[1] === at - 1) last[1] = at;
    else runs.push([at, at]);
  });
  return runs;
}

/** From the first reading to the last, of several curves together. @param {Curve[]} curves @returns {Span} */
export function spanOf(curves) {
  const starts = curves.map(({ start_s }) => start_s);
  const ends = curves.map(({ start_s, step_s, low }) => start_s + step_s * low.length);
  return { start_s: Math.min(...starts), end_s: Math.max(...ends) };
}

/** @param {Span} span @param {number} share 0 to 1 @returns {number} seconds */
export function timeAt({ start_s, end_s }, share) {
  return start_s + share * (end_s - start_s);
}

/** The path of a curve in a box that shows a span: a band from least to largest, or a bar for each count.
 * @param {Curve} curve @param {Extent} extent @param {Span} span @param {Box} box @returns {string} */
export function pathOf(curve, extent, span, box) {
  const perSecond = box.width / (span.end_s - span.start_s);
  const x = (/** @type {number} */ at) => fixed((curve.start_s + (at + 0.5) * curve.step_s - span.start_s) * perSecond);
  const y = (/** @type {number | null} */ value) => fixed(shareDown(extent, value ?? 0) * box.height);
  if (isCounted(curve)) return curve.high.map((value, at) => (value === null ? "" : `M${x(at)} ${y(0)}V${y(value)}`)).join("");
  return runsOf(curve.low).map(([first, last]) => {
    const places = Array.from({ length: last - first + 1 }, (_, k) => first + k);
    const above = places.map((at) => `${x(at)} ${y(curve.high[at])}`);
    const below = places.reverse().map((at) => `${x(at)} ${y(curve.low[at])}`);
    return `M${[...above, ...below].join("L")}Z`;
  }).join("");
}

/** @param {number} value */
function fixed(value) {
  return Number(value.toFixed(2));
}

/** The stretch in which a time lies. @param {Curve} curve @param {number} t_s */
export function stretchAt({ start_s, step_s, low }, t_s) {
  return Math.min(low.length - 1, Math.max(0, Math.floor((t_s - start_s) / step_s)));
}

/** What was read in a stretch, in words. @param {Curve} curve @param {number} at @returns {string} */
export function readingText(curve, at) {
  const [low, high] = [curve.low[at], curve.high[at]];
  if (low === null || high === null) return t("nothing read");
  const values = low === high ? tickText(low) : t("{{low}} to {{high}}", { low: tickText(low), high: tickText(high) });
  return `${values} ${curve.unit}`;
}

/** All of a curve in one line, for those who do not see it. @param {Curve} curve @returns {string} */
export function summaryOf(curve) {
  const known = curve.low.flatMap((low, at) => (low === null ? [] : [low, Number(curve.high[at])]));
  if (known.length === 0) return `${titleOf(curve)}: ${t("nothing read")}`;
  const [low, high] = [known.reduce((a, b) => Math.min(a, b)), known.reduce((a, b) => Math.max(a, b))];
  return `${titleOf(curve)}: ${t("{{low}} to {{high}}", { low: tickText(low), high: tickText(high) })} ${curve.unit}`;
}

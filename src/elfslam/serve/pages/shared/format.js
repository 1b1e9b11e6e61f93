/** Numbers as people read them, in the reader's language; a dash where nothing is known. No clock is read. */

import { counted, locale, t, translated } from "./words.js";

/** @param {unknown} value @returns {value is number} */
function isKnown(value) {
  return typeof value === "number" && Number.isFinite(value);
}

/** @type {Map<number, Intl.NumberFormat>} by digits behind the point: each is slow to make */
const formats = new Map();

/** @param {number} value @param {number} [digits] behind the point @returns {string} such as 12.4, or 12,4 */
export function formatNumber(value, digits = 0) {
  let format = formats.get(digits);
  if (!format) {
    const both = { minimumFractionDigits: digits, maximumFractionDigits: digits };
    format = new Intl.NumberFormat(locale, { ...both, useGrouping: false });
    formats.set(digits, format);
  }
  return format.format(value);
}

/** @param {number | null | undefined} bytes @returns {string} 1.4 MB; number and unit stay on one line */
export function formatBytes(bytes) {
  if (!isKnown(bytes)) return "–";
  return told(bytes).replace(" ", "\u00a0");
}

/** @param {number} bytes */
function told(bytes) {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 1e6) return `${formatNumber(bytes / 1e3, bytes < 1e4 ? 1 : 0)} kB`;
  if (bytes < 1e9) return `${formatNumber(bytes / 1e6, bytes < 1e7 ? 1 : 0)} MB`;
  return `${formatNumber(bytes / 1e9, 1)} GB`;
}

/** @param {number | null | undefined} metres @returns {string} 4 cm, 0.35 m, 12.4 m, 1.20 km */
export function formatMetres(metres) {
  if (!isKnown(metres)) return "–";
  const size = Math.abs(metres);
  if (size < 0.1) return `${Math.round(metres * 100)} cm`;
  if (size < 10) return `${formatNumber(metres, 2)} m`;
  if (size < 1000) return `${formatNumber(metres, 1)} m`;
  return `${formatNumber(metres / 1000, 2)} km`;
}

/** @param {number | null | undefined} seconds @returns {string} 1:23 or 1:02:03 */
export function formatDuration(seconds) {
  if (!isKnown(seconds)) return "–";
  const whole = Math.max(Math.floor(seconds), 0);
  const two = (/** @type {number} */ value) => String(value).padStart(2, "0");
  const minutes = Math.floor(whole / 60) % 60;
  const hours = Math.floor(whole / 3600);
  return hours ? `${hours}:${two(minutes)}:${two(whole % 60)}` : `${minutes}:${two(whole % 60)}`;
}

/** @param {number} seconds @returns {string} minutes:seconds to a tenth, with hours where there are any */
export function formatMoment(seconds) {
  const tenths = Math.max(Math.round(seconds * 10), 0);
  return `${formatDuration(Math.floor(tenths / 10))}${formatNumber((tenths % 10) / 10, 1).slice(1)}`;
}

/** @param {string | number | Date} when ISO text or time @returns {string} day and time, as spoken here */
export function formatWhen(when) {
  return new Date(when).toLocaleString(locale, { dateStyle: "medium", timeStyle: "short" });
}

/** @param {number | null | undefined} share 0 to 1 @returns {string} */
export function formatShare(share) {
  return isKnown(share) ? `${Math.round(Math.min(1, Math.max(0, share)) * 100)} %` : "";
}

/** @param {number} decibels @returns {string} with a true minus */
export function formatLevel(decibels) {
  return `${Math.round(decibels)} dB`.replace("-", "−");
}

/**
 * How long ago, in one rough unit.
 * @param {string | null | undefined} iso ISO time in UTC @param {number} nowMs
 * @returns {string} just now, 5 min ago, 3 h ago, 2 days ago, then the date
 */
export function formatAgo(iso, nowMs) {
  const then = parseTime(iso);
  if (then === null) return "–";
  const seconds = (nowMs - then) / 1000;
  if (seconds < 45) return t("just now");
  if (seconds < 3600) return t("{{minutes}} min ago", { minutes: Math.max(1, Math.round(seconds / 60)) });
  if (seconds < 86400) return t("{{hours}} h ago", { hours: Math.round(seconds / 3600) });
  if (seconds < 7 * 86400) return counted(Math.round(seconds / 86400), "{{count}} day ago", "{{count}} days ago");
  return new Date(then).toLocaleDateString(locale, { dateStyle: "medium", timeZone: "UTC" });
}

/** @param {string | null | undefined} iso @returns {number | null} ms since 1970; no zone is UTC */
export function parseTime(iso) {
  if (!iso) return null;
  const zoned = /(Z|[+-]\d\d:?\d\d)$/.test(iso) ? iso : `${iso}Z`;
  const time = Date.parse(zoned);
  return Number.isNaN(time) ? null : time;
}

/** @param {string | null | undefined} from @param {string | null | undefined} to @param {number} nowMs
 * @returns {number | null} seconds between; until now where the end is open */
export function secondsBetween(from, to, nowMs) {
  const start = parseTime(from);
  if (start === null) return null;
  return Math.max(0, ((parseTime(to) ?? nowMs) - start) / 1000);
}

/** @param {number} count @returns {string} 12,345 */
export function formatCount(count) {
  return Math.round(count).toLocaleString(locale);
}

/** @param {string} name @returns {string} a name for a file, without what file systems dislike */
export function fileName(name) {
  const safe = name.normalize("NFC").replace(/[^\p{L}\p{N}._ -]+/gu, "-").replace(/\s+/g, "_");
  return safe.replace(/^[.-]+|[.-]+$/g, "").slice(0, 80) || "map";
}

/**
 * Names without the marks that a merge puts behind them to tell namesakes apart ("hall-3fa9c1"),
 * unless that would make two of them alike.
 * @param {string[]} names @returns {Map<string, string>} from the name to what is shown
 */
export function withoutMarks(names) {
  const bare = names.map((name) => name.replace(/-[0-9a-f]{6}$/, ""));
  const alone = (/** @type {string} */ name) => bare.filter((each) => each === name).length === 1;
  return new Map(names.map((name, at) => [name, bare[at] && alone(bare[at]) ? bare[at] : name]));
}

// What the server is at, in the reader's language.

/** By the server's own names; what has another name is told as it came. @type {Record<string, string>} */
const STAGES = {
  motion: t("motion"),
  echoes: t("echoes"),
  "step length": t("step length"),
  features: t("features"),
  similarity: t("similarity"),
  closures: t("closures"),
  graph: t("graph"),
  map: t("map"),
  reading: t("reading"),
  locating: t("locating"),
  "comparing walks": t("comparing walks"),
  "joining walks": t("joining walks"),
  merged: t("merged"),
};

/** @param {string} doing as the server says it @returns {string} */
export function stageWords(doing) {
  return STAGES[doing] ?? translated(doing);
}

// What a recording lacks, in words: the same on the phone and at the desk.

/** @typedef {{what: string, from_s: number, until_s: number}} Missing a stretch without sound, or without motion */

/** @param {Missing} missing @returns {string} such as "Motion is missing from 0:59.2 to 1:00.0" */
export function missingLine({ what, from_s: fromS, until_s: untilS }) {
  const ends = { from: formatMoment(fromS), until: formatMoment(untilS) };
  if (what === "sound") return t("Sound is missing from {{from}} to {{until}}", ends);
  if (what === "motion") return t("Motion is missing from {{from}} to {{until}}", ends);
  return t("{{what}} is missing from {{from}} to {{until}}", { what, ...ends });
}

/**
 * One sentence for all of them, empty where nothing is missing.
 * @param {Missing[] | undefined} missing @param {number} [most] of them that are told one by one
 * @returns {string}
 */
export function missingWords(missing = [], most = 3) {
  const lines = missing.slice(0, most).map(missingLine);
  const others = missing.length - lines.length;
  if (others > 0) lines.push(counted(others, "{{count}} more stretch like it", "{{count}} more stretches like it"));
  return lines.length === 0 ? "" : `${lines.join("; ")}.`;
}

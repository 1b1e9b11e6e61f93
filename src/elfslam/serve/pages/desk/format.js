// Numbers as people read them; a dash where nothing is known. Pure: no clock, no zone.

import * as shared from "../shared/format.js";
import { counted, locale, t } from "../shared/words.js";

/** @param {unknown} value @returns {value is number} */
function isKnown(value) {
  return typeof value === "number" && Number.isFinite(value);
}

/** @param {number | null | undefined} bytes @returns {string} 1.4 MB */
export function formatBytes(bytes) {
  return isKnown(bytes) ? shared.formatBytes(bytes) : "–";
}

/** @param {number | null | undefined} seconds @returns {string} 1:23 or 1:02:03 */
export function formatDuration(seconds) {
  return isKnown(seconds) ? shared.formatDuration(seconds) : "–";
}

/** @param {number | null | undefined} metres @returns {string} 4 cm, 0.35 m, 12.4 m, 1.20 km */
export function formatMetres(metres) {
  return isKnown(metres) ? shared.formatMetres(metres) : "–";
}

/** @param {number | null | undefined} share 0 to 1 @returns {string} */
export function formatShare(share) {
  return isKnown(share) ? shared.formatShare(Math.min(1, Math.max(0, share))) : "";
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

/** Numbers as people read them, in the reader's language. */

import { locale } from "./words.js";

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

/** @param {number} bytes @returns {string} number and unit stay on one line */
export function formatBytes(bytes) {
  return told(bytes).replace(" ", "\u00a0");
}

/** @param {number} bytes */
function told(bytes) {
  if (bytes < 1000) return `${bytes} B`;
  if (bytes < 1e6) return `${formatNumber(bytes / 1e3, bytes < 1e4 ? 1 : 0)} kB`;
  if (bytes < 1e9) return `${formatNumber(bytes / 1e6, bytes < 1e7 ? 1 : 0)} MB`;
  return `${formatNumber(bytes / 1e9, 1)} GB`;
}

/** @param {number} metres @returns {string} 4 cm, 0.35 m, 12.4 m, 1.20 km */
export function formatMetres(metres) {
  const size = Math.abs(metres);
  if (size < 0.1) return `${Math.round(metres * 100)} cm`;
  if (size < 10) return `${formatNumber(metres, 2)} m`;
  if (size < 1000) return `${formatNumber(metres, 1)} m`;
  return `${formatNumber(metres / 1000, 2)} km`;
}

/** @param {number} seconds @returns {string} minutes:seconds, with hours where there are any */
export function formatDuration(seconds) {
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

/** @param {number} share @returns {string} */
export function formatShare(share) {
  return `${Math.round(share * 100)} %`;
}

/** @param {number} decibels @returns {string} with a true minus */
export function formatLevel(decibels) {
  return `${Math.round(decibels)} dB`.replace("-", "−");
}

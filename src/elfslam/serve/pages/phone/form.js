/** What the walker says before the walk. */

import { locale, t } from "../shared/words.js";

/**
 * The start pose from three texts; null where all are empty. Raises RangeError.
 * @param {string} x metres @param {string} y metres @param {string} heading degrees
 * @returns {number[] | null} x_m, y_m, heading_rad
 */
export function parseStart(x, y, heading) {
  const texts = [x, y, heading].map((text) => text.trim().replace(",", ".").replace("−", "-"));
  if (texts.every((text) => text === "")) return null;
  const numbers = texts.map((text) => (text === "" ? NaN : Number(text)));
  if (!numbers.every(Number.isFinite)) {
    throw new RangeError(t("Where it starts: give x, y and heading as numbers, or leave all three empty."));
  }
  const [xM, yM, degrees] = numbers;
  return [xM, yM, (degrees * Math.PI) / 180];
}

/** @param {Date} now @returns {string} a name for a walk that was given none */
export function usualName(now) {
  const day = now.toLocaleDateString(locale, { day: "numeric", month: "short" });
  if (now.getHours() < 12) return t("Morning walk, {{day}}", { day });
  return now.getHours() < 18 ? t("Afternoon walk, {{day}}", { day }) : t("Evening walk, {{day}}", { day });
}

/** @param {Date} now @param {number} random below 1 @returns {string} a key that sorts by time */
export function walkKey(now, random) {
  const time = now.toISOString().replace(/[-:]|\.\d+/g, "");
  return `${time}-${Math.floor(random * 0xffff).toString(16).padStart(4, "0")}`;
}

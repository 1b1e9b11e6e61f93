// Located walks: the CSV of a locate job. Pure.

import { t } from "../../shared/words.js";

/** @typedef {{t_s: number, xy_m: [number, number] | null, heading_rad: number | null, sigma_m: number | null, status: string}} Fix */

const FIX_COLUMNS = ["t_s", "x_m", "y_m", "heading_rad", "sigma_m", "status"];

/** What the statuses mean to people. @type {Record<string, string>} */
export const STATUS_WORDS = {
  OK: t("located"),
  AMBIGUOUS: t("several places sound alike"),
  UNKNOWN_PLACE: t("unknown place"),
  NO_ECHO: t("no echo heard"),
  SUSPECT: t("sound not to be trusted"),
};

/** The rows of a fixes file; columns by name. Throws Error naming what is missing.
 * @param {string} text @returns {Fix[]} */
export function parseFixes(text) {
  const [head, ...lines] = text.trim().split(/\r?\n/);
  const names = head.split(",");
  const missing = FIX_COLUMNS.filter((name) => !names.includes(name));
  if (missing.length > 0) throw new Error(t("The fixes lack the column {{column}}; locate again.", { column: missing[0] }));
  return lines.filter((line) => line !== "").map((line) => fixOf(names, line.split(",")));
}

/** @param {string[]} names @param {string[]} cells @returns {Fix} */
function fixOf(names, cells) {
  const cell = (/** @type {string} */ name) => cells[names.indexOf(name)] ?? "";
  const number = (/** @type {string} */ name) => (cell(name) === "" ? null : Number(cell(name)));
  const [x_m, y_m] = [number("x_m"), number("y_m")];
  return {
    t_s: Number(cell("t_s")),
    xy_m: x_m === null || y_m === null ? null : [x_m, y_m],
    heading_rad: number("heading_rad"),
    sigma_m: number("sigma_m"),
    status: cell("status"),
  };
}

/** How many fixes have each status, the most frequent first. @param {Fix[]} fixes
 * @returns {[string, number][]} */
export function countStatuses(fixes) {
  /** @type {Map<string, number>} */
  const counts = new Map();
  for (const { status } of fixes) counts.set(status, (counts.get(status) ?? 0) + 1);
  return [...counts].sort((a, b) => b[1] - a[1]);
}

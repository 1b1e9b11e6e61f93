/** What a recording lacks, in words: the same on the phone and at the desk. */

import { formatMoment } from "./format.js";
import { counted, t } from "./words.js";

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

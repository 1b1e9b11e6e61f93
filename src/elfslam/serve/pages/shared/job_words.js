/** What the server is at, in the reader's language. */

import { formatMoment } from "./format.js";
import { counted, t, translated } from "./words.js";

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

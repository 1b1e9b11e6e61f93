/** What the server is at, in the reader's language. */

import { t, translated } from "./words.js";

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

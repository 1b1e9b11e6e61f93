// On the page of a map: what its recording has along its time, what is missing, and mapping it again.

import { h, icon } from "../shared/dom.js";
import { missingLine } from "../shared/job_words.js";
import { formatMoment } from "../shared/format.js";
import { courseLanes, courseOf } from "./timeline.js";
import { part } from "./viewer/panel.js";
import { t } from "../shared/words.js";

/** @typedef {import("./store.js").Map_} Map_ */
/** @typedef {import("./store.js").Recording} Recording */
/** @typedef {import("./timeline.js").Span} Span */

/** Hidden for a map of several walks, and where the recording is gone and lacked nothing.
 * @param {Map_} map @param {Recording | undefined} recording @param {() => void} again */
export function recordedPart({ kind, facts }, recording, again) {
  const missing = /** @type {import("../shared/job_words.js").Missing[]} */ (facts?.missing ?? []);
  if (kind !== "run" || (!recording && missing.length === 0)) return h("section", { hidden: true });
  const kept = keptOf(facts);
  const course = recording ? courseOf(recording) : null;
  const words = kept ? t("Mapped from {{from}} to {{until}}.", { from: formatMoment(kept[0]), until: untilWords(kept[1], course?.duration_s) }) : t("All of it is mapped.");
  return part(t("Recording"), [
    course && courseLanes(course, kept ?? undefined),
    h("p", { class: "soft" }, words),
    missing.length > 0 && h("ul", { class: "missing" }, missing.map((each) => h("li", null, missingLine(each)))),
    recording && h("button", { type: "button", class: "button", click: again }, icon("again"), t("Trim and map again"))]);
}

/** The stretch that a map was made of; null where that is all. @param {any} facts @returns {Span | null} */
export function keptOf(facts) {
  const kept = facts?.kept_s;
  return Array.isArray(kept) && kept.length === 2 ? [Number(kept[0]), Number(kept[1])] : null;
}

/** @param {number} until_s @param {number | undefined} duration_s */
function untilWords(until_s, duration_s) {
  return until_s < (duration_s ?? 1e6) ? formatMoment(until_s) : t("the end");
}

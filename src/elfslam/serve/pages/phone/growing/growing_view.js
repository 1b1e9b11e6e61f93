/** What the growing map says in words, and the places that the walker marks. */

import { formatMetres, formatShare } from "../../shared/format.js";
import { t } from "../../shared/words.js";
import { at, make } from "../view.js";
import { placesOf } from "./growing_map.js";
import { confirmedShare } from "./sketch.js";

const SETTING_OFF = t("The map grows as you walk.");
const FIRST_LOOP = t("Come by again where you have been: that closes the first loop.");
const WITHOUT = t("This browser draws no map meanwhile. The walk is recorded all the same.");
/** From here on a loop may be expected. */
const SOON_M = 25;

/** @param {import("./sketch.js").Sketch} sketch */
export function showSketch(sketch) {
  const lengthM = lengthOf(sketch);
  const isClosed = sketch.loops.length > 0;
  const confirmed = formatShare(confirmedShare(sketch.poses.length / 3, sketch.loops));
  const length = formatMetres(lengthM);
  const told = isClosed
    ? t("{{length}} walked, {{confirmed}} of it confirmed by loops.", { length, confirmed })
    : t("{{length}} walked.", { length });
  at("growing-canvas").setAttribute("aria-label", t("The map so far: {{told}}", { told }));
  say(`${isClosed || lengthM > SOON_M ? told : SETTING_OFF} ${adviceOf(sketch, lengthM)}`.trim());
}

/** The walk is recorded, and not drawn. */
export function showWithout() {
  at("growing-stage").hidden = true;
  say(WITHOUT);
}

/** Before the first footstep. */
export function showNoSketch() {
  at("growing-stage").hidden = false;
  at("mark-here").disabled = true; // until something is recorded
  say(SETTING_OFF);
}

/** @param {string} said */
function say(said) {
  if (at("growing-said").textContent !== said) at("growing-said").textContent = said;
}

/** What to walk next. @param {import("./sketch.js").Sketch} sketch @param {number} lengthM */
export function adviceOf({ loops, next }, lengthM) {
  if (loops.length === 0) return lengthM < SOON_M ? "" : FIRST_LOOP;
  return next ? t("Walk the dashed part again next.") : t("Walk where you have not been, or stop.");
}

/** @param {import("./sketch.js").Sketch} sketch */
function lengthOf({ poses, gaps }) {
  const broken = new Set(gaps);
  return placesOf(poses).reduce((sum, [x, y], k, places) =>
    k === 0 || broken.has(k) ? sum : sum + Math.hypot(x - places[k - 1][0], y - places[k - 1][1]), 0);
}

/**
 * The places marked so far as buttons, each of which says "I am there again".
 * @param {string[]} names @param {(name: string) => void} again
 */
export function showMarks(names, again) {
  const buttons = names.map((name) =>
    make("button", { type: "button", className: "quiet", ariaLabel: t("I am at {{name}} again", { name }), onclick: () => again(name) }, [name]));
  at("mark-here").disabled = false;
  at("marks").replaceChildren(...buttons);
  at("marks-again").hidden = names.length === 0;
}

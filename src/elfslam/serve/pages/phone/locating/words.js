/** What a fix says, in words. Pure. */

import { formatNumber } from "../../shared/format.js";
import { inSentence, t, translated } from "../../shared/words.js";

/** @typedef {"OK" | "AMBIGUOUS" | "UNKNOWN_PLACE" | "NO_ECHO" | "SUSPECT"} Status */
/**
 * @typedef {object} Fix
 * @property {number} tS
 * @property {[number, number] | null} xyM
 * @property {number} headingRad
 * @property {Covariance | null} covarianceM2
 * @property {number} score
 * @property {Status} status
 * @property {string} [reason] why it is suspect
 * @property {number | null} [level] in a building, null where it is not known; the place is then one on the floor shown
 */
/** @typedef {{verdict: "pass" | "doubt" | "fail" | "wait", title: string, line: string}} Words */

/** @type {Record<"track" | "one-shot", Words>} before the first fix */
export const WAITING = {
  track: { verdict: "wait", title: t("Listening"), line: t("Walk a few steps, the phone held in front of you.") },
  "one-shot": { verdict: "wait", title: t("Listening"), line: t("Hold the phone in front of you.") },
};

/** @type {Words} while the map and the encoder are made ready */
export const READYING = { verdict: "wait", title: t("Getting ready"), line: t("This takes a few seconds.") };
/** @type {Words} */
export const STOPPED = { verdict: "wait", title: t("Stopped"), line: t("The map shows where you were.") };

/** @type {Words} as long as the vote of the echoes decides on no floor of a building */
export const FLOOR_UNKNOWN = {
  verdict: "doubt",
  title: t("Floor unknown"),
  line: t("The echoes do not tell the floors apart yet. Walk on, or tap the floor that you are on."),
};
/** What echoes say that come from one of the floors. */
const SOUNDS_KNOWN = ["OK", "AMBIGUOUS", "UNKNOWN_PLACE"];

/** @param {number} metres @returns {string} "0.3 m", "12 m": no finer than it is known */
export function within(metres) {
  return `${metres < 9.95 ? formatNumber(Math.max(metres, 0.1), 1) : Math.round(metres)}\u00a0m`;
}

/** @param {Fix} fix @returns {Words} */
export function wordsOf(fix) {
  if (fix.level === null && SOUNDS_KNOWN.includes(fix.status)) return FLOOR_UNKNOWN;
  return SAYING[fix.status]?.(fix) ?? { verdict: "doubt", title: fix.status, line: "" };
}

/** @type {Record<Status, (fix: Fix) => Words>} */
const SAYING = {
  OK: (fix) => ({ verdict: "pass", title: t("Here, within {{distance}}", { distance: howFar(fix) }), line: t("The echoes fit the map.") }),
  AMBIGUOUS: (fix) => ({
    verdict: "doubt",
    title: t("One of several places"),
    line: fix.xyM
      ? t("More than one place sounds like this. The likeliest is shown, within {{distance}}. Walk on.", { distance: howFar(fix) })
      : t("More than one place sounds like this. Walk on."),
  }),
  UNKNOWN_PLACE: () => ({
    verdict: "fail",
    title: t("An unknown place"),
    line: t("Nothing in this map sounds like this: you have left it, or it has changed."),
  }),
  NO_ECHO: (fix) => ({
    verdict: "doubt",
    title: t("No echoes heard"),
    line: fix.xyM
      ? t("Counting steps since, within {{distance}}. Is the loudspeaker covered, or the volume down?", { distance: howFar(fix) })
      : t("Is the loudspeaker covered, or the volume down?"),
  }),
  SUSPECT: (fix) => ({
    verdict: "fail",
    title: t("Not to be trusted"),
    line: `${sentence(fix.reason ? translated(fix.reason) : t("What is heard does not fit what was played"))}${
      fix.xyM ? ` ${t("Counting steps since, within {{distance}}.", { distance: howFar(fix) })}` : ""}`,
  }),
};

/** @param {Fix} fix */
function howFar({ covarianceM2 }) {
  return covarianceM2 ? within(radiusOf(covarianceM2)) : t("an unknown distance");
}

/** @param {string} text */
function sentence(text) {
  const trimmed = text.trim();
  const upper = trimmed.charAt(0).toUpperCase() + trimmed.slice(1);
  return /[.!?]$/.test(upper) ? upper : `${upper}.`;
}

const POINTS = [
  t("east"), t("north-east"), t("north"), t("north-west"), t("west"), t("south-west"), t("south"), t("south-east"),
];

/** Where it is, for those who do not see the map: x runs to the east. @param {Fix} fix */
export function placeSpoken({ xyM, headingRad }) {
  if (!xyM) return t("No place is known.");
  const [x, y] = xyM.map((metres) => `${metres < 0 ? `${t("minus")} ` : ""}${formatNumber(Math.abs(metres), 1)}`);
  if (!Number.isFinite(headingRad)) return t("At {{x}} across and {{y}} up.", { x, y });
  return t("At {{x}} across and {{y}} up, facing {{towards}} on the map.", { x, y, towards: mapTowards(headingRad) });
}

/** A direction on the map, whose x runs to the east. @param {number} headingRad */
export function mapTowards(headingRad) {
  return POINTS[((Math.round((4 * headingRad) / Math.PI) % 8) + 8) % 8];
}

/** What a floor is called whose map does not say. @param {number} level 0 at the entrance */
export function floorName(level) {
  return level === 0 ? t("Ground floor") : t("Floor {{level}}", { level });
}

/** The same as where somebody goes. @param {number} level */
export function theFloor(level) {
  return level === 0 ? t("the ground floor") : inSentence(floorName(level));
}

// How sure a fix is, as an ellipse and as a radius. Pure.

/** @typedef {[number, number, number]} Covariance xx, xy, yy in square metres */

/** Of the places where the walker may be, so many lie within: two of three. */
const SHARE = 2 / 3;
/** Sigmas that hold this share of a bell curve in the plane. */
export const SIGMAS = Math.sqrt(-2 * Math.log(1 - SHARE));

/**
 * @param {Covariance} covariance
 * @returns {{majorM: number, minorM: number, turnRad: number}} half axes of the ellipse that holds SHARE;
 *   turnRad: of the long one, counter-clockwise from x
 */
export function ellipseOf([xx, xy, yy]) {
  const middle = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  return {
    majorM: SIGMAS * Math.sqrt(Math.max(middle + spread, 0)),
    minorM: SIGMAS * Math.sqrt(Math.max(middle - spread, 0)),
    turnRad: 0.5 * Math.atan2(2 * xy, xx - yy),
  };
}

/** The circle that stands for it in words. @param {Covariance} covariance @returns {number} metres */
export function radiusOf([xx, , yy]) {
  return SIGMAS * Math.sqrt(Math.max((xx + yy) / 2, 0));
}

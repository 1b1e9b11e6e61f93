/** What a fix says, in words. Pure. */

import { radiusOf } from "./ellipse.js";

/** @typedef {"OK" | "AMBIGUOUS" | "UNKNOWN_PLACE" | "NO_ECHO" | "SUSPECT"} Status */
/**
 * @typedef {object} Fix
 * @property {number} tS
 * @property {[number, number] | null} xyM
 * @property {number} headingRad
 * @property {import("./ellipse.js").Covariance | null} covarianceM2
 * @property {number} score
 * @property {Status} status
 * @property {string} [reason] why it is suspect
 */
/** @typedef {{verdict: "pass" | "doubt" | "fail" | "wait", title: string, line: string}} Words */

/** @type {Record<"track" | "one-shot", Words>} before the first fix */
export const WAITING = {
  track: { verdict: "wait", title: "Listening", line: "Walk a few steps, the phone held in front of you." },
  "one-shot": { verdict: "wait", title: "Listening", line: "Hold the phone in front of you." },
};

/** @type {Words} while the map and the encoder are made ready */
export const READYING = { verdict: "wait", title: "Getting ready", line: "This takes a few seconds." };
/** @type {Words} */
export const STOPPED = { verdict: "wait", title: "Stopped", line: "The map shows where you were." };

/** @param {number} metres @returns {string} "0.3 m", "12 m": no finer than it is known */
export function within(metres) {
  return metres < 9.95 ? `${Math.max(metres, 0.1).toFixed(1)}\u00a0m` : `${Math.round(metres)}\u00a0m`;
}

/** @param {Fix} fix @returns {Words} */
export function wordsOf(fix) {
  return SAYING[fix.status]?.(fix) ?? { verdict: "doubt", title: fix.status, line: "" };
}

/** @type {Record<Status, (fix: Fix) => Words>} */
const SAYING = {
  OK: (fix) => ({ verdict: "pass", title: `Here, within ${howFar(fix)}`, line: "The echoes fit the map." }),
  AMBIGUOUS: (fix) => ({
    verdict: "doubt",
    title: "One of several places",
    line: fix.xyM
      ? `More than one place sounds like this. The likeliest is shown, within ${howFar(fix)}. Walk on.`
      : "More than one place sounds like this. Walk on.",
  }),
  UNKNOWN_PLACE: () => ({
    verdict: "fail",
    title: "An unknown place",
    line: "Nothing in this map sounds like this: you have left it, or it has changed.",
  }),
  NO_ECHO: (fix) => ({
    verdict: "doubt",
    title: "No echoes heard",
    line: fix.xyM
      ? `Counting steps since, within ${howFar(fix)}. Is the loudspeaker covered, or the volume down?`
      : "Is the loudspeaker covered, or the volume down?",
  }),
  SUSPECT: (fix) => ({
    verdict: "fail",
    title: "Not to be trusted",
    line: `${sentence(fix.reason ?? "What is heard does not fit what was played")}${
      fix.xyM ? ` Counting steps since, within ${howFar(fix)}.` : ""}`,
  }),
};

/** @param {Fix} fix */
function howFar({ covarianceM2 }) {
  return covarianceM2 ? within(radiusOf(covarianceM2)) : "an unknown distance";
}

/** @param {string} text */
function sentence(text) {
  const trimmed = text.trim();
  const upper = trimmed.charAt(0).toUpperCase() + trimmed.slice(1);
  return /[.!?]$/.test(upper) ? upper : `${upper}.`;
}

const POINTS = ["east", "north-east", "north", "north-west", "west", "south-west", "south", "south-east"];

/** Where it is, for those who do not see the map: x runs to the east. @param {Fix} fix */
export function placeSpoken({ xyM, headingRad }) {
  if (!xyM) return "No place is known.";
  const [x, y] = xyM.map((metres) => metres.toFixed(1).replace("-", "minus "));
  const eighth = ((Math.round((4 * headingRad) / Math.PI) % 8) + 8) % 8;
  const towards = Number.isFinite(headingRad) ? `, facing ${POINTS[eighth]} on the map` : "";
  return `At ${x} across and ${y} up${towards}.`;
}

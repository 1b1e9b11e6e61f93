// Curves of least and largest values, as paths in a box and as words. Pure.

import { locale, t } from "../../shared/words.js";

/** @typedef {{name: string, unit: string, start_s: number, step_s: number, low: (number | null)[], high: (number | null)[]}} Curve */
/** @typedef {{low: number, high: number}} Extent */
/** @typedef {{start_s: number, end_s: number}} Span */
/** @typedef {{width: number, height: number}} Box */

/** What the server calls a curve, and what people do. @type {Record<string, string>} */
const NAMES = {
  acceleration: t("Acceleration"),
  "yaw rate": t("Turning"),
  "magnetic field": t("Magnetic field"),
  "access points": t("Wi-Fi access points"),
  "sound level": t("Sound level"),
};

/** Counted one by one: bars from zero, where others are bands. */
const COUNTED = ["access points"];

/** @param {Curve} curve */
export function titleOf({ name }) {
  return NAMES[name] ?? name;
}

/** @param {Curve} curve */
export function isCounted({ name }) {
  return COUNTED.includes(name);
}

/** From the least to the largest, never without height. @param {Curve} curve @returns {Extent | null} */
export function extentOf(curve) {
  const known = [...curve.low, ...curve.high].filter((value) => value !== null);
  if (known.length === 0) return null;
  const low = isCounted(curve) ? 0 : known.reduce((a, b) => Math.min(a, b));
  const high = known.reduce((a, b) => Math.max(a, b));
  const least = Math.max(1e-9, Math.abs(high) * 1e-3);
  return high - low >= least ? { low, high } : { low: low - least, high: high + least };
}

/** Round numbers within an extent, two to five. @param {Extent} extent @returns {number[]} */
export function ticksOf({ low, high }) {
  const rough = (high - low) / 5;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * ([1, 2, 5, 10].find((each) => each * power >= rough) ?? 10);
  const ticks = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k += 1) ticks.push(Number((k * step).toPrecision(12)));
  return ticks;
}

/** A number as a tick says it. @param {number} value @returns {string} */
export function tickText(value) {
  return Number(value.toPrecision(4)).toLocaleString(locale, { maximumSignificantDigits: 4, useGrouping: false }).replace("-", "−");
}

/** How far down a value lies, 0 at the top. @param {Extent} extent @param {number} value */
export function shareDown({ low, high }, value) {
  return (high - value) / (high - low);
}

/** Stretches in a row that were read: first and last of each. @param {(number | null)[]} values
 * @returns {[number, number][]} */
export function runsOf(values) {
  /** @type {[number, number][]} */
  const runs = [];
  values.forEach((value, at) => {
    if (value === null) return;
    const last = runs.at(-1);
    if (last && last[1] === at - 1) last[1] = at;
    else runs.push([at, at]);
  });
  return runs;
}

/** From the first reading to the last, of several curves together. @param {Curve[]} curves @returns {Span} */
export function spanOf(curves) {
  const starts = curves.map(({ start_s }) => start_s);
  const ends = curves.map(({ start_s, step_s, low }) => start_s + step_s * low.length);
  return { start_s: Math.min(...starts), end_s: Math.max(...ends) };
}

/** @param {Span} span @param {number} share 0 to 1 @returns {number} seconds */
export function timeAt({ start_s, end_s }, share) {
  return start_s + share * (end_s - start_s);
}

/** The path of a curve in a box that shows a span: a band from least to largest, or a bar for each count.
 * @param {Curve} curve @param {Extent} extent @param {Span} span @param {Box} box @returns {string} */
export function pathOf(curve, extent, span, box) {
  const perSecond = box.width / (span.end_s - span.start_s);
  const x = (/** @type {number} */ at) => fixed((curve.start_s + (at + 0.5) * curve.step_s - span.start_s) * perSecond);
  const y = (/** @type {number | null} */ value) => fixed(shareDown(extent, value ?? 0) * box.height);
  if (isCounted(curve)) return curve.high.map((value, at) => (value === null ? "" : `M${x(at)} ${y(0)}V${y(value)}`)).join("");
  return runsOf(curve.low).map(([first, last]) => {
    const places = Array.from({ length: last - first + 1 }, (_, k) => first + k);
    const above = places.map((at) => `${x(at)} ${y(curve.high[at])}`);
    const below = places.reverse().map((at) => `${x(at)} ${y(curve.low[at])}`);
    return `M${[...above, ...below].join("L")}Z`;
  }).join("");
}

/** @param {number} value */
function fixed(value) {
  return Number(value.toFixed(2));
}

/** The stretch in which a time lies. @param {Curve} curve @param {number} t_s */
export function stretchAt({ start_s, step_s, low }, t_s) {
  return Math.min(low.length - 1, Math.max(0, Math.floor((t_s - start_s) / step_s)));
}

/** What was read in a stretch, in words. @param {Curve} curve @param {number} at @returns {string} */
export function readingText(curve, at) {
  const [low, high] = [curve.low[at], curve.high[at]];
  if (low === null || high === null) return t("nothing read");
  const values = low === high ? tickText(low) : t("{{low}} to {{high}}", { low: tickText(low), high: tickText(high) });
  return `${values} ${curve.unit}`;
}

/** All of a curve in one line, for those who do not see it. @param {Curve} curve @returns {string} */
export function summaryOf(curve) {
  const known = curve.low.flatMap((low, at) => (low === null ? [] : [low, Number(curve.high[at])]));
  if (known.length === 0) return `${titleOf(curve)}: ${t("nothing read")}`;
  const [low, high] = [known.reduce((a, b) => Math.min(a, b)), known.reduce((a, b) => Math.max(a, b))];
  return `${titleOf(curve)}: ${t("{{low}} to {{high}}", { low: tickText(low), high: tickText(high) })} ${curve.unit}`;
}

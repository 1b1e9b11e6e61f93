/** Motion events as rows of a recording: phone axes, m/s2 with gravity, rad/s. */

import { eventTime } from "./clocks.js";

/**
 * @typedef {{x: number | null, y: number | null, z: number | null}} Vector
 * @typedef {{alpha: number | null, beta: number | null, gamma: number | null}} Turning
 * @typedef {{accelerationIncludingGravity: Vector | null, rotationRate: Turning | null}} MotionReading
 */

/**
 * Lying on its back a phone reads +9.8 along z, as on Android; Apple's have the opposite sign.
 * @param {{userAgent: string, platform?: string, maxTouchPoints?: number}} browser
 * @returns {1 | -1}
 */
export function accelerationSign({ userAgent, platform = "", maxTouchPoints = 0 }) {
  const isTablet = platform === "MacIntel" && maxTouchPoints > 1;
  return /iPhone|iPad|iPod/.test(userAgent) || isTablet ? -1 : 1;
}

/** @param {MotionReading} event @param {1 | -1} sign @returns {number[] | null} x, y, z in m/s2 */
export function accelerationOf({ accelerationIncludingGravity: a }, sign) {
  if (!a || a.x === null || a.y === null || a.z === null) return null;
  return [sign * a.x, sign * a.y, sign * a.z];
}

/**
 * About x, y and z the browsers say alpha, beta and gamma, in degrees per second.
 * @param {MotionReading} event @returns {number[] | null} rad/s
 */
export function turningOf({ rotationRate: r }) {
  if (!r || r.alpha === null || r.beta === null || r.gamma === null) return null;
  return [r.alpha, r.beta, r.gamma].map((value) => (value * Math.PI) / 180);
}

/** A row of a sensor's table. @param {number} tS @param {number[]} values */
export function tableRow(tS, values) {
  return `${[tS, ...values].map((value) => value.toFixed(6)).join(",")}\n`;
}

export const TABLE_HEADER = "t_s,x,y,z\n";

/**
 * How often readings come, and how strong they are in the middle: what the probe asks.
 * @param {number[]} timesMs @param {number[][]} accelerations
 * @returns {{rateHz: number, gravityMps2: number, longestGapS: number}}
 */
export function describeMotion(timesMs, accelerations) {
  if (timesMs.length < 2) return { rateHz: 0, gravityMps2: NaN, longestGapS: Infinity };
  const gaps = timesMs.slice(1).map((time, k) => time - timesMs[k]);
  const strengths = accelerations.map((a) => Math.hypot(...a)).sort((a, b) => a - b);
  return {
    rateHz: (1000 * gaps.length) / (timesMs[timesMs.length - 1] - timesMs[0]),
    gravityMps2: strengths[strengths.length >> 1] ?? NaN,
    longestGapS: Math.max(...gaps) / 1000,
  };
}

const STEP_MPS2 = 1.0;
const STEP_APART_S = 0.3;
const FORGETTING_S = 0.6;

/**
 * Footsteps as they come, for the display alone: upward crossings of a threshold by the strength of
 * the acceleration over its own slow mean.
 * @typedef {{count: number, meanMps2: number, lastS: number, tS: number, isHigh: boolean}} Steps
 * @type {Steps}
 */
export const NO_STEPS = { count: 0, meanMps2: NaN, lastS: -Infinity, tS: NaN, isHigh: false };

/** @param {Steps} steps @param {number} tS @param {number[]} acceleration @returns {Steps} */
export function countStep(steps, tS, acceleration) {
  const strength = Math.hypot(...acceleration);
  if (Number.isNaN(steps.meanMps2)) return { ...steps, meanMps2: strength, tS };
  const share = Math.min(Math.max(tS - steps.tS, 0) / FORGETTING_S, 1);
  const meanMps2 = steps.meanMps2 + share * (strength - steps.meanMps2);
  const isHigh = strength - meanMps2 > (steps.isHigh ? 0 : STEP_MPS2);
  const isStep = isHigh && !steps.isHigh && tS - steps.lastS > STEP_APART_S;
  return {
    count: steps.count + (isStep ? 1 : 0),
    lastS: isStep ? tS : steps.lastS,
    meanMps2,
    tS,
    isHigh,
  };
}

// Motion as it comes from the browser, each reading with its time on the page's clock.

/**
 * Must be called from a tap, before anything is waited for: some browsers ask only then.
 * @returns {Promise<boolean>} whether motion may be read
 */
export async function allowMotion() {
  /** @type {(() => Promise<string>) | undefined} of Apple alone */
  const ask = /** @type {any} */ (window.DeviceMotionEvent)?.requestPermission;
  if (!window.DeviceMotionEvent) return false;
  if (!ask) return true;
  try {
    return (await ask.call(window.DeviceMotionEvent)) === "granted";
  } catch {
    return false;
  }
}

/**
 * @param {(pageMs: number, acceleration: number[] | null, turning: number[] | null) => void} heard
 * @returns {() => void} stops listening
 */
export function listenToMotion(heard) {
  const sign = accelerationSign(navigator);
  const onMotion = (/** @type {DeviceMotionEvent} */ event) => {
    const pageMs = eventTime(event.timeStamp, performance.now());
    heard(pageMs, accelerationOf(event, sign), turningOf(event));
  };
  window.addEventListener("devicemotion", onMotion);
  return () => window.removeEventListener("devicemotion", onMotion);
}

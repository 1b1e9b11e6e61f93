/** Motion as it comes from the browser, each reading with its time on the page's clock. */

import { accelerationOf, accelerationSign, turningOf } from "./motion.js";
import { eventTime } from "./clocks.js";

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

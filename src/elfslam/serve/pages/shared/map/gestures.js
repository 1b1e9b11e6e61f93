// Mouse, touch and keyboard on the canvas, as changes of the view.

import { pan, pinch, zoomAt } from "./projection.js";

/** @typedef {import("./projection.js").Point} Point */
/** @typedef {import("./projection.js").View} View */
/**
 * @typedef {object} Hands
 * @property {() => {view: View, size: import("./projection.js").Size}} look
 * @property {(view: View) => void} turnTo
 * @property {(at_px: Point, reach_px: number) => void} point something is under the finger
 * @property {(at_px: Point) => void} [tap] a finger or the mouse was put there and taken away
 * @property {() => void} leave nothing is
 * @property {(at_px: Point, reach_px: number) => ((to_px: Point) => void) | null} grab what a drag
 * moves instead of the map
 * @property {() => void} drop a grab has ended
 * @property {() => void} fit
 * @property {(by: number) => void} step to the next footstep or the one before
 */

const TOUCH_REACH_PX = 22;
const MOUSE_REACH_PX = 12;
const TAP_PX = 6;
const STEP_PX = 60;

/** @param {HTMLElement} canvas @param {Hands} hands */
export function onGestures(canvas, hands) {
  listenToPointers(canvas, hands);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    const factor = Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0018));
    const { view, size } = hands.look();
    hands.turnTo(zoomAt(view, size, placeOf(event, canvas), factor));
  }, { passive: false });
  canvas.addEventListener("dblclick", (event) => {
    const { view, size } = hands.look();
    hands.turnTo(zoomAt(view, size, placeOf(event, canvas), event.shiftKey ? 0.5 : 2));
  });
  canvas.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const deed = keyDeed(event.key, hands);
    if (!deed) return;
    event.preventDefault();
    deed();
  });
}

/** @param {string} key @param {Hands} hands @returns {(() => void) | undefined} */
function keyDeed(key, hands) {
  const { view, size } = hands.look();
  const middle = /** @type {Point} */ ([size.width / 2, size.height / 2]);
  const by = (/** @type {number} */ x, /** @type {number} */ y) => () => hands.turnTo(pan(view, [x, y]));
  const zoom = (/** @type {number} */ factor) => () => hands.turnTo(zoomAt(view, size, middle, factor));
  /** @type {Record<string, () => void>} */
  const deeds = {
    ArrowLeft: by(STEP_PX, 0), ArrowRight: by(-STEP_PX, 0), ArrowUp: by(0, STEP_PX), ArrowDown: by(0, -STEP_PX),
    "+": zoom(1.4), "=": zoom(1.4), "-": zoom(1 / 1.4), _: zoom(1 / 1.4),
    "0": hands.fit, Home: hands.fit,
    "]": () => hands.step(1), "[": () => hands.step(-1), Escape: hands.leave,
  };
  return deeds[key];
}

/** @param {HTMLElement} canvas @param {Hands} hands */
function listenToPointers(canvas, hands) {
  /** @type {Map<number, Point>} */
  const down = new Map();
  /** @type {((to_px: Point) => void) | null} */
  let grabbed = null;
  let travelled_px = 0;

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    canvas.setPointerCapture(event.pointerId);
    down.set(event.pointerId, placeOf(event, canvas));
    travelled_px = down.size === 1 ? 0 : Infinity;
    if (down.size === 1) grabbed = hands.grab(placeOf(event, canvas), reachOf(event));
    else if (grabbed) release();
  });
  canvas.addEventListener("pointermove", (event) => {
    const now = placeOf(event, canvas);
    const last = down.get(event.pointerId);
    if (!last) return event.pointerType === "mouse" ? hands.point(now, MOUSE_REACH_PX) : undefined;
    const { view, size } = hands.look();
    travelled_px += Math.hypot(now[0] - last[0], now[1] - last[1]);
    const other = [...down].find(([id]) => id !== event.pointerId)?.[1];
    down.set(event.pointerId, now);
    if (grabbed) grabbed(now);
    else if (other) hands.turnTo(pinch(view, size, [last, other], [now, other]));
    else hands.turnTo(pan(view, [now[0] - last[0], now[1] - last[1]]));
    return undefined;
  });
  const up = (/** @type {PointerEvent} */ event) => {
    const place = down.get(event.pointerId);
    down.delete(event.pointerId);
    if (!place) return;
    if (grabbed) release();
    if (travelled_px >= TAP_PX || event.type !== "pointerup") return;
    hands.tap?.(place);
    hands.point(place, reachOf(event));
  };
  function release() {
    grabbed = null;
    hands.drop();
  }
  canvas.addEventListener("pointerup", up);
  canvas.addEventListener("pointercancel", up);
  canvas.addEventListener("pointerleave", (event) => {
    if (event.pointerType === "mouse" && down.size === 0) hands.leave();
  });
}

/** @param {PointerEvent} event */
function reachOf(event) {
  return event.pointerType === "mouse" ? MOUSE_REACH_PX : TOUCH_REACH_PX;
}

/** @param {MouseEvent} event @param {HTMLElement} canvas @returns {Point} */
function placeOf(event, canvas) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

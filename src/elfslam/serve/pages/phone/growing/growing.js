/** The map that grows while a walk is recorded: a worker is fed with what the walk hears, and its sketches are shown. */

import { formatMetres, formatShare } from "../../shared/format.js";
import { density, dot, drawGrid, inMetres, makeScale, mountSurface, stroke } from "../../shared/map/ground.js";
import { boundsOf, fit, toScreen } from "../../shared/map/projection.js";
import { t } from "../../shared/words.js";
import { soundTime } from "../clocks.js";
import { sendMotion } from "../locating/place.js";
import { paletteOf } from "../locating/place_map.js";
import { at, make } from "../view.js";
import { confirmedShare } from "./sketch.js";

const PARAMETERS = new URL("../../stages/parameters.json", import.meta.url);
const ENCODER = new URL("../../stages/encoder.onnx", import.meta.url);

/**
 * What the server's line is set to, as far as drawing a walk needs it.
 * @typedef {{
 *   chirp: import("../../stages/chirp.js").ChirpParameters,
 *   echo: import("../../stages/echo.js").EchoParameters, motion: import("../../stages/motion/filters.js").MotionParameters,
 *   locate: {fewest_echoes: number}, medium_access: import("../../stages/hearing.js").MediumAccessParameters,
 *   closure: import("./sketch.js").ClosureParameters,
 * }} GrowingParameters
 * @typedef {import("../devices.js").Devices} Devices
 * @typedef {{slot: number, start: number, played: number | null, gainDb: number}} Slot frames of the clock
 */

/**
 * The map of one walk. What cannot be drawn, as in a browser without WebAssembly, stops nothing: the walk is recorded
 * all the same.
 * @returns {{segment: (devices: Devices) => {slot: (slot: Slot) => void, end: () => void},
 *   mark: (name: string, pageMs: number) => void, leave: () => void}}
 */
export function startGrowing() {
  const worker = new Worker(new URL("./growing.worker.js", import.meta.url), { type: "module" });
  const files = fetchFiles();
  files.catch(() => showWithout());
  const map = mountGrowingMap();
  /** @type {(pageMs: number) => number} */
  let timeOf = () => 0;
  worker.onerror = () => showWithout();
  worker.onmessage = ({ data }) => {
    if (data.is === "problem") showWithout();
    if (data.is !== "sketch") return;
    map.show(data.sketch);
    showSketch(data.sketch);
  };

  /** @param {Devices & {measured?: import("../probe.js").Measured | null}} devices */
  const segment = ({ microphone, clocks, measured }) => {
    const rateHz = microphone.context.sampleRate;
    const { port1, port2 } = new MessageChannel();
    timeOf = (pageMs) => soundTime(clocks.line(), pageMs);
    files.then(({ parameters, encoderBytes }) => {
      worker.postMessage({ do: "segment", rateHz, parameters, encoderBytes, source: port1, echoDb: measured?.echoDb ?? null }, [port1]);
      microphone.pour("growing", port2);
    }, () => {});
    const stopMotion = sendMotion(worker, clocks);
    return {
      slot: (/** @type {Slot} */ { slot, start, played, gainDb }) => {
        const playedS = played === null ? null : played / rateHz;
        const order = { do: "slot", slot: { slot, startS: start / rateHz, playedS, gainDb } };
        files.then(() => worker.postMessage(order), () => {}); // behind the segment that it belongs to
      },
      end: () => {
        stopMotion();
        microphone.pour("growing", null);
      },
    };
  };

  return {
    segment,
    mark: (name, pageMs) => worker.postMessage({ do: "mark", name, tS: timeOf(pageMs) }),
    leave: () => {
      worker.terminate();
      map.leave();
    },
  };
}

/** @returns {Promise<{parameters: GrowingParameters, encoderBytes: Uint8Array<ArrayBuffer>}>} */
async function fetchFiles() {
  const [parameters, encoder] = await Promise.all([fetch(PARAMETERS), fetch(ENCODER)]);
  if (!parameters.ok || !encoder.ok) throw new Error(`${parameters.status}, ${encoder.status}`);
  return { parameters: await parameters.json(), encoderBytes: new Uint8Array(await encoder.arrayBuffer()) };
}

// What the growing map says in words, and the places that the walker marks.

const SETTING_OFF = t("The map grows as you walk.");
const FIRST_LOOP = t("Come by again where you have been: that closes the first loop.");
const WITHOUT = t("This browser draws no map meanwhile. The walk is recorded all the same.");
/** From here on a loop may be expected. */
const SOON_M = 25;

/** @param {import("./sketch.js").Sketch} sketch */
function showSketch(sketch) {
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
function showWithout() {
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

// The walk so far on a canvas: what is covered, the way, loops that have closed, and what to walk next.

/** So far around the walker a floor counts as covered: a lane. */
const LANE_M = 0.8;
const MARGIN_PX = 26;
/** No closer than that, however short the walk. */
const LEAST_M = 4;
const WAY_PX = 3;
const DOT_PX = 8;
const NAME_PX = 14;

/**
 * @typedef {import("./sketch.js").Sketch} Sketch
 * @typedef {import("../../shared/map/projection.js").Point} Point
 * @typedef {{view: import("../../shared/map/projection.js").View, size: import("../../shared/map/projection.js").Size,
 *   sketch: Sketch | null}} Shown
 */

/** On the view of a walk. @returns {{show: (sketch: Sketch) => void, leave: () => void}} */
function mountGrowingMap() {
  const canvas = at("growing-canvas");
  /** @type {Shown} */
  const shown = { view: { x_m: 0, y_m: 0, px_per_m: 40 }, size: { width: 340, height: 220 }, sketch: null };
  const scale = makeScale();
  at("growing-stage").append(scale.bar);
  const turn = () => {
    if (shown.sketch) shown.view = fit(boundsAround(placesOf(shown.sketch.poses)), shown.size, MARGIN_PX);
  };
  const { redraw, leave } = mountSurface(canvas, {
    paletteOf,
    paint(palette) {
      drawSketch(canvas.getContext("2d"), shown, palette, density());
      scale.show(shown.view);
    },
    resized(size) {
      shown.size = size;
      turn();
    },
  });
  redraw();
  return {
    show(sketch) {
      shown.sketch = sketch;
      turn();
      redraw();
    },
    leave() {
      leave();
      scale.bar.remove();
      canvas.getContext("2d").clearRect(0, 0, canvas.width, canvas.height);
    },
  };
}

/** @param {Float64Array} poses @returns {Point[]} */
function placesOf(poses) {
  return Array.from({ length: poses.length / 3 }, (_, k) => [poses[3 * k], poses[3 * k + 1]]);
}

/** Around all of it, and never less than a room. @param {Point[]} places
 * @returns {import("../../shared/map/projection.js").Bounds} */
function boundsAround(places) {
  const [x0, y0, x1, y1] = boundsOf(places) ?? [0, 0, 0, 0];
  const [wide, high] = [Math.max(LEAST_M - (x1 - x0), 2 * LANE_M) / 2, Math.max(LEAST_M - (y1 - y0), 2 * LANE_M) / 2];
  return [x0 - wide, y0 - high, x1 + wide, y1 + high];
}

/** @param {CanvasRenderingContext2D} context @param {Shown} shown
 * @param {import("../locating/place_map.js").Palette} palette @param {number} pixels per pixel of the page */
function drawSketch(context, shown, palette, pixels) {
  const { size, view, sketch } = shown;
  context.setTransform(pixels, 0, 0, pixels, 0, 0);
  context.clearRect(0, 0, size.width, size.height);
  drawGrid(context, shown, palette);
  if (!sketch) return;
  const places = placesOf(sketch.poses);
  inMetres(context, shown, pixels);
  const way = wayOf(places, new Set(sketch.gaps));
  stroke(context, way, palette.accentSoft, 2 * LANE_M * view.px_per_m, shown);
  stroke(context, loopsOf(sketch.loops, places), palette.accent, 1.5, shown, 0.6);
  stroke(context, way, palette.ink, WAY_PX, shown, 0.85);
  if (sketch.next) drawNext(context, shown, places.slice(sketch.next[0], sketch.next[1] + 1), palette);
  context.setTransform(pixels, 0, 0, pixels, 0, 0);
  drawMarks(context, shown, places, palette);
  context.lineWidth = 3;
  dot(context, toScreen(view, size, places[places.length - 1]), DOT_PX, palette.accent, palette.surface);
}

/** @param {Point[]} places @param {Set<number>} gaps */
function wayOf(places, gaps) {
  const path = new Path2D();
  places.forEach(([x, y], k) => (k === 0 || gaps.has(k) ? path.moveTo(x, y) : path.lineTo(x, y)));
  return path;
}

/** @param {[number, number][]} loops @param {Point[]} places */
function loopsOf(loops, places) {
  const path = new Path2D();
  for (const [i, j] of loops) {
    path.moveTo(...places[i]);
    path.lineTo(...places[j]);
  }
  return path;
}

/** Dashed, so that it is told by more than its colour. @param {CanvasRenderingContext2D} context @param {Shown} shown
 * @param {Point[]} places @param {import("../locating/place_map.js").Palette} palette */
function drawNext(context, shown, places, palette) {
  const { px_per_m } = shown.view;
  context.setLineDash([10 / px_per_m, 9 / px_per_m]);
  stroke(context, wayOf(places, new Set()), palette.surface, WAY_PX + 4, shown);
  stroke(context, wayOf(places, new Set()), palette.doubt, WAY_PX + 2, shown);
  context.setLineDash([]);
}

/** @param {CanvasRenderingContext2D} context @param {Shown} shown @param {Point[]} places
 * @param {import("../locating/place_map.js").Palette} palette */
function drawMarks(context, { view, size, sketch }, places, palette) {
  /** @type {Set<string>} */
  const named = new Set();
  context.font = `600 ${NAME_PX}px ${getComputedStyle(document.body).fontFamily}`;
  for (const { name, at: footstep } of sketch?.marks ?? []) {
    const [x, y] = toScreen(view, size, places[footstep]);
    context.lineWidth = 2;
    dot(context, [x, y], DOT_PX - 2, palette.surface, palette.ink);
    if (named.has(name)) continue;
    named.add(name);
    context.lineWidth = 4;
    context.strokeStyle = palette.surface;
    context.fillStyle = palette.ink;
    context.strokeText(name, x + DOT_PX + 2, y + NAME_PX / 3);
    context.fillText(name, x + DOT_PX + 2, y + NAME_PX / 3);
  }
}

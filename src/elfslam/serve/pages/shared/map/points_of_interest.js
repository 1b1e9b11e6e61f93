// Rooms, doors and other places of a map that have a name: what each kind is called, and how they are drawn.

import { dot } from "./ground.js";
import { toScreen } from "./projection.js";
import { t } from "../words.js";

/** @typedef {import("./projection.js").Point} Point */
/** @typedef {"room" | "door" | "stairs" | "lift" | "other"} PointKind */
/** @typedef {{name: string, kind: PointKind, x_m: number, y_m: number}} PointOfInterest */
/** @typedef {{left: number, top: number, right: number, bottom: number}} Box */

/** @type {Record<PointKind, string>} */
export const KIND_WORDS = { room: t("room"), door: t("door"), stairs: t("stairs"), lift: t("lift"), other: t("other place") };

const DOT_PX = 4.5;
const TEXT_PX = 13;
const GAP_PX = 8;

/**
 * A dot for each place, and its name where there is room for it; the chosen one is larger and always has its name.
 * @param {CanvasRenderingContext2D} context in pixels of the page @param {import("./ground.js").Look} look
 * @param {PointOfInterest[]} points @param {{ink: string, surface: string, accent: string}} palette
 * @param {PointOfInterest | null} [chosen]
 */
export function drawPointsOfInterest(context, { view, size }, points, palette, chosen = null) {
  context.save();
  context.lineWidth = 2;
  const first = points.filter((each) => each === chosen);
  /** @type {Box[]} */
  const taken = [];
  for (const point of [...first, ...points.filter((each) => each !== chosen)]) {
    const isChosen = point === chosen;
    const at_px = toScreen(view, size, [point.x_m, point.y_m]);
    dot(context, at_px, isChosen ? DOT_PX + 3 : DOT_PX, isChosen ? palette.accent : palette.ink, palette.surface);
    context.font = `${isChosen ? 700 : 550} ${TEXT_PX}px system-ui, sans-serif`;
    const box = labelBox(at_px, context.measureText(point.name).width);
    if (!isChosen && taken.some((other) => overlap(box, other))) continue;
    taken.push(box);
    label(context, point.name, box, palette);
  }
  context.restore();
}

/** Where the name of a place stands: to the right of its dot. @param {Point} at_px @param {number} width_px
 * @returns {Box} */
export function labelBox([x, y], width_px) {
  const left = x + DOT_PX + GAP_PX / 2;
  return { left, top: y - TEXT_PX / 2 - 2, right: left + width_px, bottom: y + TEXT_PX / 2 + 2 };
}

/** @param {Box} one @param {Box} other */
export function overlap(one, other) {
  return one.left < other.right && other.left < one.right && one.top < other.bottom && other.top < one.bottom;
}

/** @param {CanvasRenderingContext2D} context @param {string} name @param {Box} box
 * @param {{ink: string, surface: string}} palette */
function label(context, name, { left, top, bottom }, palette) {
  context.textBaseline = "middle";
  context.lineJoin = "round";
  context.lineWidth = 4;
  context.strokeStyle = palette.surface;
  context.strokeText(name, left, (top + bottom) / 2);
  context.fillStyle = palette.ink;
  context.fillText(name, left, (top + bottom) / 2);
  context.lineWidth = 2;
}

// Walkers who let others see where they are: what is known of them, and how they are drawn.

import { toScreen } from "../../shared/map/projection.js";
import { mark } from "./marks.js";

/** @typedef {import("../../shared/map/projection.js").Point} Point */
/**
 * @typedef {object} Told what the server says of a position
 * @property {string} walker @property {string} name @property {string} walk @property {string} status
 * @property {number | null} x_m @property {number | null} y_m
 * @property {number | null} heading_rad @property {number | null} sigma_m
 */
/**
 * @typedef {object} Walker
 * @property {string} key @property {string} name @property {string} status
 * @property {Point | null} xy_m the last place that was known
 * @property {boolean} isPlaced whether that is where they are now
 * @property {number | null} sigma_m @property {number | null} heading_rad
 * @property {number} heard_ms when the last word of them came
 */

/** Whoever was not heard of for so long is shown no more. */
export const LASTS_MS = 10_000;
/** Sigmas of the circle that holds two places of three. */
const SIGMAS = Math.sqrt(2 * Math.log(3));
const BEAM_PX = 15;

/** @param {{walker: string, walk: string}} told */
const keyOf = ({ walker, walk }) => `${walker} ${walk}`;

/** @param {Walker[]} walkers @param {Told} told @param {number} now_ms @returns {Walker[]} by name */
export function withPosition(walkers, told, now_ms) {
  const key = keyOf(told);
  const before = walkers.find((each) => each.key === key);
  const isPlaced = told.x_m !== null && told.y_m !== null;
  /** @type {Walker} */
  const now = {
    key, name: told.name, status: told.status, isPlaced, heard_ms: now_ms,
    xy_m: isPlaced ? /** @type {Point} */ ([told.x_m, told.y_m]) : before?.xy_m ?? null,
    sigma_m: isPlaced ? told.sigma_m : null,
    heading_rad: isPlaced ? told.heading_rad : null,
  };
  const others = walkers.filter((each) => each.key !== key);
  return [...others, now].sort((a, b) => a.name.localeCompare(b.name) || a.key.localeCompare(b.key));
}

/** @param {Walker[]} walkers @param {{walker: string, walk: string}} gone @returns {Walker[]} */
export function withoutWalk(walkers, gone) {
  return walkers.filter(({ key }) => key !== keyOf(gone));
}

/** @param {Walker[]} walkers @param {number} now_ms @returns {Walker[]} */
export function stillThere(walkers, now_ms) {
  return walkers.filter(({ heard_ms }) => now_ms - heard_ms < LASTS_MS);
}

/** A mark in the shape of the status, a circle of uncertainty, and the name.
 * @param {CanvasRenderingContext2D} context @param {import("./state.js").State} state
 * @param {ReturnType<typeof import("./state.js").paletteOf>} palette */
export function drawLive(context, { live, view, size }, palette) {
  for (const walker of live) {
    if (!walker.xy_m) continue;
    const at_px = toScreen(view, size, walker.xy_m);
    context.save();
    if (!walker.isPlaced) context.globalAlpha = 0.55;
    if (walker.sigma_m !== null) drawCircle(context, at_px, SIGMAS * walker.sigma_m * view.px_per_m, palette);
    if (walker.heading_rad !== null) drawHeading(context, at_px, walker.heading_rad, palette);
    mark(context, at_px, walker.status, palette);
    drawName(context, at_px, walker.name, palette);
    context.restore();
  }
}

/** @param {CanvasRenderingContext2D} context @param {Point} at_px @param {number} radius_px @param {{accent: string}} palette */
function drawCircle(context, at_px, radius_px, { accent }) {
  const alpha = context.globalAlpha;
  context.beginPath();
  context.arc(...at_px, Math.max(radius_px, 8), 0, 2 * Math.PI);
  context.fillStyle = context.strokeStyle = accent;
  context.lineWidth = 1.5;
  context.globalAlpha = 0.18 * alpha;
  context.fill();
  context.globalAlpha = 0.9 * alpha;
  context.stroke();
  context.globalAlpha = alpha;
}

/** @param {CanvasRenderingContext2D} context @param {Point} at_px @param {number} heading_rad @param {{accent: string}} palette */
function drawHeading(context, [x, y], heading_rad, { accent }) {
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(x + BEAM_PX * Math.cos(heading_rad), y - BEAM_PX * Math.sin(heading_rad));
  context.strokeStyle = accent;
  context.lineWidth = 3;
  context.stroke();
}

/** @param {CanvasRenderingContext2D} context @param {Point} at_px @param {string} name
 * @param {{ink: string, surface: string}} palette */
function drawName(context, [x, y], name, { ink, surface }) {
  context.font = "600 13px system-ui, sans-serif";
  context.textAlign = "center";
  context.textBaseline = "top";
  context.lineJoin = "round";
  context.lineWidth = 4;
  context.strokeStyle = surface;
  context.fillStyle = ink;
  context.strokeText(name, x, y + 10);
  context.fillText(name, x, y + 10);
}

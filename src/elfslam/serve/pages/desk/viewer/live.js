// Walkers who let others see where they are: what is known of them, and how they are drawn.

import { requestJson } from "../../shared/api.js";
import { h } from "../../shared/dom.js";
import { toScreen } from "../../shared/map/projection.js";
import { t } from "../../shared/words.js";
import { orSay } from "../dialogs.js";
import { mark } from "./draw.js";
import { part } from "./panel.js";
import { STATUS_WORDS } from "./scene.js";

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
 * @param {CanvasRenderingContext2D} context @param {import("./scene.js").State} state
 * @param {ReturnType<typeof import("./scene.js").paletteOf>} palette */
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

// Beside the map: who lets others see where they are, heard live, and the switch of the map's owner.

/** @typedef {import("./scene.js").State} State */
/** @typedef {{is_on: boolean, origin: {latitude_deg: number, longitude_deg: number, bearing_deg: number} | null}} Settings */

const LOOK_EVERY_MS = 1000;

/**
 * @param {string} id of the map @param {State} state @param {() => void} redraw
 * @returns {{part: HTMLElement, leave: () => void}}
 */
export function livePart(id, state, redraw) {
  const path = `/api/maps/${encodeURIComponent(id)}/positions`;
  const list = h("ul", { class: "live", "aria-label": t("Who is here") });
  const words = h("p", { class: "soft" }, t("Asking the server…"));
  const input = h("input", { type: "checkbox", role: "switch", name: "live", disabled: true });
  const body = [h("label", { class: "tick" }, input, h("span", null, t("Take and show live positions"))), list, words];
  /** @type {EventSource | null} */
  let source = null;
  /** @type {Settings} */
  let settings = { is_on: false, origin: null };
  let shown = "";
  let isLeft = false;

  function show() {
    state.live = stillThere(state.live, Date.now());
    const now = JSON.stringify(state.live.map(({ key, name, status }) => [key, name, status]));
    if (now !== shown) list.replaceChildren(...state.live.map(rowOf));
    shown = now;
    list.hidden = state.live.length === 0;
    words.hidden = state.live.length > 0;
    words.textContent = settings.is_on
      ? t("Nobody at this moment. Whoever is located here on a phone may switch on “Let others see where I am”.")
      : t("Nobody's position is taken for this map.");
  }

  function listen() {
    source?.close();
    source = null;
    state.live = [];
    if (settings.is_on && !isLeft) {
      source = new EventSource(`${path}/stream`);
      source.addEventListener("position", ({ data }) => heard((now_ms) => withPosition(state.live, JSON.parse(data), now_ms)));
      source.addEventListener("gone", ({ data }) => heard(() => withoutWalk(state.live, JSON.parse(data))));
    }
    show();
    redraw();
  }

  /** @param {(now_ms: number) => State["live"]} change */
  function heard(change) {
    state.live = change(Date.now());
    show();
    redraw();
  }

  async function load() {
    settings = await requestJson(`${path}/settings`);
    input.checked = settings.is_on;
    input.disabled = false;
    listen();
  }

  input.addEventListener("change", () => void orSay(async () => {
    try {
      settings = await requestJson(`${path}/settings`, { method: "PUT", json: { ...settings, is_on: input.checked } });
    } finally {
      input.checked = settings.is_on;
    }
    listen();
  }));
  const timer = setInterval(() => {
    const before = state.live.length;
    show();
    if (state.live.length !== before) redraw();
  }, LOOK_EVERY_MS);
  void orSay(load);
  return {
    part: part(t("Live positions"), body),
    leave() {
      isLeft = true;
      clearInterval(timer);
      source?.close();
    },
  };
}

/** @param {Walker} walker */
function rowOf({ name, status }) {
  return h("li", null, h("i", { class: `fix ${status}` }), h("span", null, name), h("small", null, STATUS_WORDS[status] ?? status));
}

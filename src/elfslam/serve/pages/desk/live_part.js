// Beside the map: who lets others see where they are, heard live, and the switch of the map's owner.

import { requestJson } from "../shared/api.js";
import { orSay } from "./dialogs.js";
import { h } from "../shared/dom.js";
import { STATUS_WORDS } from "./viewer/fixes.js";
import { stillThere, withoutWalk, withPosition } from "./viewer/live.js";
import { part } from "./viewer/panel.js";
import { t } from "../shared/words.js";

/** @typedef {import("./viewer/state.js").State} State */
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

/** @param {import("./viewer/live.js").Walker} walker */
function rowOf({ name, status }) {
  return h("li", null, h("i", { class: `fix ${status}` }), h("span", null, name), h("small", null, STATUS_WORDS[status] ?? status));
}

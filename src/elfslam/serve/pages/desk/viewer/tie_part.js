// Scaling and placing a floor plan by points, step by step: two buttons in the panel, and a bar on the map.

import { h } from "../../shared/dom.js";
import { askFor, FEWEST_PAIRS, noTie, scaledTo, tapped, tied, wantedNext } from "./tying.js";
import { t } from "../../shared/words.js";

/** @typedef {import("./state.js").State} State */
/** @typedef {import("../../shared/map/placement.js").Placement} Placement */

/**
 * @param {State} state @param {{place: (placement: Placement, finished: boolean) => void, redraw: () => void, changed: () => void}} told
 */
export function tiePart(state, { place, redraw, changed }) {
  const words = h("p", { role: "status" });
  const done = h("button", { type: "button", class: "button small", click: end }, t("Done"));
  const length = h("input", { type: "number", step: "0.01", min: "0.1", name: "plan-length", inputmode: "decimal" });
  const form = h("form", { class: "row" }, h("label", { class: "field" }, h("span", null, t("Length, m")), length),
    h("button", { type: "submit", class: "button" }, t("Scale it")));
  const bar = h("div", { class: "tie-bar", hidden: true }, words, form, done);
  form.addEventListener("submit", (/** @type {Event} */ event) => {
    event.preventDefault();
    const made = state.tie && state.plan && scaledTo(state.tie, state.plan.placement, length.valueAsNumber);
    if (!made) {
      words.textContent = t("These two places and this length give no plan of 0.1 to 5000 m; give another length, or begin again.");
      return;
    }
    place(made, true);
    end();
  });

  /** @param {import("./tying.js").TieKind} kind */
  function begin(kind) {
    state.tie = noTie(kind);
    state.placing = false;
    state.naming = false;
    changed();
    bar.closest(".stage")?.scrollIntoView({ block: "nearest" });
  }

  function end() {
    state.tie = null;
    changed();
  }

  /** @param {import("../../shared/map/projection.js").Point} xy_m */
  function tap(xy_m) {
    const { tie, plan } = state;
    if (!tie || !plan) return;
    state.tie = tapped(tie, plan.placement, xy_m);
    const isPair = state.tie.kind === "points" && state.tie.map.length === state.tie.plan.length;
    const made = isPair ? tied(state.tie, plan.placement) : null;
    if (isPair && !made && state.tie.map.length >= FEWEST_PAIRS) state.tie = noTie("points");
    if (made) place(made, true);
    show();
    redraw();
  }

  function show() {
    bar.hidden = state.tie === null;
    if (!state.tie) return;
    words.textContent = askFor(state.tie);
    form.hidden = state.tie.kind !== "length" || wantedNext(state.tie) !== null;
  }

  function part() {
    show();
    const begins = (/** @type {import("./tying.js").TieKind} */ kind, /** @type {string} */ title) =>
      h("button", { type: "button", class: "button", "aria-pressed": String(state.tie?.kind === kind), click: () => begin(kind) }, title);
    return [h("div", { class: "row" }, begins("points", t("Place by points")), begins("length", t("Scale by a length")))];
  }

  return { part, tap, bar };
}

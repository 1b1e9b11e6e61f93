/** Places that the walker taps on the floor plan of a map on this phone, while a walk is recorded. */

import { openPackages } from "../../keeping/packages.js";
import { openStore } from "../../keeping/store.js";
import { h } from "../../shared/dom.js";
import { onGestures } from "../../shared/map/gestures.js";
import { density, drawGrid, drawPlan, loadPlanImage, mountSurface, zoomButtons } from "../../shared/map/ground.js";
import { corners } from "../../shared/map/placement.js";
import { drawPointsOfInterest } from "../../shared/map/points_of_interest.js";
import { boundsOf, fit, toMap } from "../../shared/map/projection.js";
import { counted, t } from "../../shared/words.js";
import { paletteOf } from "../locating/place_map.js";
import { at, make } from "../view.js";

/**
 * @typedef {import("../manifest.js").Walk} Walk
 * @typedef {import("../../shared/map/projection.js").Point} Point
 * @typedef {{keep: (name: string) => void, leave: () => void}} Tapping keep: what was tapped last has this name
 */

/**
 * One plan for a walk: as soon as a place on it has its name there is no other.
 * @param {Walk} state @param {(work: () => Promise<void>) => (event?: Event) => Promise<void>} act
 * @returns {Promise<Tapping>}
 */
export async function openTapping(state, act) {
  const packages = openPackages(await openStore());
  const planned = (await packages.list()).filter(({ isOnPlan }) => isOnPlan);
  const choice = /** @type {HTMLSelectElement} */ (at("tapping-map"));
  const opener = /** @type {HTMLDetailsElement} */ (at("tapping"));
  /** @type {Point | null} */
  let tapped = null;
  /** @type {ReturnType<typeof mountPlanToTap> | null} */
  let drawn = null;

  choice.replaceChildren(...planned.map(({ map, name }) => make("option", { value: map }, [name])));
  if (state.tappedOn) choice.value = state.tappedOn;
  choice.disabled = state.tappedOn !== undefined;
  opener.open = false;
  opener.hidden = choice.value === "";

  async function show() {
    const { facts: { floorPlan, pointsOfInterest } } = await packages.open(choice.value);
    if (!floorPlan?.placement) return;
    const address = URL.createObjectURL(new Blob([floorPlan.bytes], { type: floorPlan.type }));
    const picture = await loadPlanImage(address).finally(() => URL.revokeObjectURL(address));
    drawn?.leave();
    tapped = null;
    const plan = { ...picture, placement: floorPlan.placement };
    const named = [...pointsOfInterest, ...Object.entries(state.taps ?? {}).map(pointOf)];
    drawn = mountPlanToTap(at("tapping-stage"), plan, named, (xyM) => {
      tapped = xyM;
      suggest(placeAt(named, xyM)?.name ?? "");
    });
  }

  const opened = act(async () => {
    if (opener.open && !drawn) await show();
  });
  const changed = act(show);
  opener.addEventListener("toggle", opened);
  choice.addEventListener("change", changed);

  return {
    keep(name) {
      if (tapped === null) return;
      state.taps = { ...state.taps, [name]: tapped };
      state.tappedOn = choice.value;
      choice.disabled = true;
      tapped = null;
      drawn?.settle(name);
      const count = Object.keys(state.taps).length;
      at("tapping-said").textContent = counted(count, "{{count}} place tapped on the plan.", "{{count}} places tapped on the plan.");
    },
    leave() {
      opener.removeEventListener("toggle", opened);
      choice.removeEventListener("change", changed);
      drawn?.leave();
      at("tapping-stage").replaceChildren();
    },
  };
}

/** @param {[string, Point]} tap @returns {import("../../shared/map/points_of_interest.js").PointOfInterest} */
function pointOf([name, [x_m, y_m]]) {
  return { name, kind: "other", x_m, y_m };
}

/** The name of a place, into the field, where the walker has not written another. @param {string} name */
function suggest(name) {
  const field = /** @type {HTMLInputElement} */ (at("mark-name"));
  if (field.value !== "" && field.value !== field.dataset.suggested) return;
  field.value = name;
  field.dataset.suggested = name;
}

// A floor plan on a canvas, on which the walker taps where they stand.

/**
 * @typedef {import("../../shared/map/points_of_interest.js").PointOfInterest} PointOfInterest
 */

const HELP = t("Tap where you stand. Drag or arrow keys move the plan, plus and minus zoom, Enter takes its middle.");
const MARGIN_PX = 12;
/** A tap this near to a place that has a name means that place. */
const NEAR_M = 1.5;

/**
 * @param {HTMLElement} stage that gets the canvas @param {import("../../shared/map/ground.js").Plan} plan
 * @param {PointOfInterest[]} named places that have a name already @param {(xyM: Point) => void} tapped
 */
function mountPlanToTap(stage, plan, named, tapped) {
  const bounds = /** @type {[number, number, number, number]} */ (boundsOf(corners(plan.placement, plan.aspect)));
  const size = { width: 340, height: 260 };
  const shown = { view: fit(bounds, size, MARGIN_PX), size, plan };
  let points = named;
  /** @type {PointOfInterest | null} */
  let pin = null;
  const canvas = h("canvas", { tabindex: "0", role: "application", "aria-roledescription": t("floor plan"), "aria-label": HELP });

  function paint(/** @type {import("../locating/place_map.js").Palette} */ palette) {
    const context = canvas.getContext("2d");
    context.setTransform(density(), 0, 0, density(), 0, 0);
    context.clearRect(0, 0, shown.size.width, shown.size.height);
    drawGrid(context, shown, palette);
    drawPlan(context, shown);
    drawPointsOfInterest(context, shown, pin ? [...points, pin] : points, palette, pin);
  }

  /** @param {Point} atPx */
  function take(atPx) {
    const [x_m, y_m] = toMap(shown.view, shown.size, atPx);
    pin = { name: "", kind: "other", x_m, y_m };
    tapped([x_m, y_m]);
    redraw();
  }

  const hands = {
    look: () => shown,
    turnTo: (/** @type {typeof shown.view} */ view) => {
      shown.view = view;
      redraw();
    },
    fit: () => hands.turnTo(fit(bounds, shown.size, MARGIN_PX)),
    tap: take, point() {}, leave() {}, grab: () => null, drop() {}, step() {},
  };
  onGestures(canvas, hands);
  canvas.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
    if (event.key === "Enter") take([shown.size.width / 2, shown.size.height / 2]);
  });
  const { redraw, leave } = mountSurface(canvas, {
    paletteOf, paint,
    resized(now) {
      shown.size = now;
      shown.view = fit(bounds, now, MARGIN_PX);
    },
  });
  stage.replaceChildren(canvas, zoomButtons(hands));
  /** What was tapped last has its name now. @param {string} name */
  const settle = (name) => {
    if (pin) points = [...points.filter((each) => each.name !== name), { ...pin, name }];
    pin = null;
    redraw();
  };
  return { leave, settle };
}

/** The place with a name that a tap means, if any. @param {PointOfInterest[]} points @param {Point} xyM */
export function placeAt(points, [x, y]) {
  const away = (/** @type {PointOfInterest} */ { x_m, y_m }) => Math.hypot(x_m - x, y_m - y);
  const [nearest] = [...points].sort((one, other) => away(one) - away(other));
  return nearest && away(nearest) <= NEAR_M ? nearest : null;
}

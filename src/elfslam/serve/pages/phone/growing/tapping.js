/** Places that the walker taps on the floor plan of a map on this phone, while a walk is recorded. */

import { openPackages } from "../../keeping/packages.js";
import { openStore } from "../../keeping/store.js";
import { loadPlanImage } from "../../shared/map/ground.js";
import { counted } from "../../shared/words.js";
import { at, make } from "../view.js";
import { mountPlanToTap, placeAt } from "./plan_to_tap.js";

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

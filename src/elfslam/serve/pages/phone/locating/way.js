/** The way to a room, a door or another named place of the map that the walker is in. */

import { KIND_WORDS } from "../../shared/map/points_of_interest.js";
import { byName } from "../../shared/places.js";
import { at, make } from "../view.js";
import { pointsOf } from "./ground_of_map.js";
import { walkedGroundOf, wayFrom, waysTo } from "./walked_ground.js";
import { wayWords } from "./way_words.js";
import { t } from "../../shared/words.js";

/** @typedef {import("../../shared/map/points_of_interest.js").PointOfInterest} PointOfInterest */
/** @typedef {import("./words.js").Fix} Fix */

/**
 * Offers the named places of a map.
 * @param {{xyM: Float32Array}} floorMap @param {PointOfInterest[]} points
 * @param {(goal: PointOfInterest | null, line: import("../../shared/map/projection.js").Point[]) => void} show on the map
 */
export function offerWays(floorMap, points, show) {
  const sorted = [...points].sort((one, other) => byName(one.name, other.name));
  /** @type {ReturnType<typeof walkedGroundOf> | null} */
  let ground = null;
  /** @type {{goal: PointOfInterest, ways: import("./walked_ground.js").Ways} | null} */
  let wanted = null;
  /** @type {Fix | null} */
  let latest = null;
  let said = "";
  const choice = /** @type {HTMLSelectElement} */ (at("way-to"));
  at("way").hidden = sorted.length === 0;
  choice.replaceChildren(make("option", { value: "" }, [t("nowhere")]),
    ...sorted.map(({ name, kind }, k) => make("option", { value: String(k) }, [`${name} (${KIND_WORDS[kind] ?? kind})`])));
  choice.onchange = () => {
    const goal = choice.value === "" ? null : sorted[Number(choice.value)];
    ground ??= walkedGroundOf(pointsOf(floorMap.xyM));
    wanted = goal && { goal, ways: waysTo(ground, [goal.x_m, goal.y_m]) };
    tell();
  };

  function tell() {
    const from_m = latest?.status === "OK" ? latest.xyM : null;
    const way = wanted && from_m ? wayFrom(wanted.ways, from_m) : null;
    said = wanted ? wayWords(wanted.goal.name, latest, way, wanted.ways.goal_m) : "";
    show(wanted?.goal ?? null, way?.line ?? []);
    at("way-words").textContent = said;
    at("way-words").hidden = wanted === null;
  }

  tell();
  return {
    /** @returns {string} "" where nobody asks */
    words: () => said,
    /** @param {Fix | null} fix null before the first */
    fix(fix) {
      latest = fix;
      tell();
    },
  };
}

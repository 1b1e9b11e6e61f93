/** How far it is to a place and which way, in words. Pure. */

import { between, pointAlong } from "./walked_ground.js";
import { mapTowards, within } from "./words.js";
import { t } from "../../shared/words.js";

/** @typedef {import("./words.js").Fix} Fix */
/** @typedef {import("../../shared/map/projection.js").Point} Point */
/** @typedef {NonNullable<ReturnType<typeof import("./walked_ground.js").wayFrom>>} Way */

/** Who is so near sees it. */
const THERE_M = 1.5;
/** Nobody turns for the first step alone. */
const AHEAD_M = 2;

const TURNS = [
  t("straight ahead"), t("half left"), t("to the left"), t("sharp left"), t("behind you"), t("sharp right"),
  t("to the right"), t("half right"),
];

/** A way that is hardly longer than the straight line is told as one. */
const STRAIGHT = 1.15;

/**
 * The straight line is the least that it can be, the walked way leads there for sure; the shortest is between.
 * @param {string} name @param {Fix | null} fix the latest @param {Way | null} way from there; null where no walk
 * leads @param {Point} goal_m
 */
export function wayWords(name, fix, way, goal_m) {
  if (!fix?.xyM || fix.status !== "OK") return t("{{name}}: told once your place is known", { name });
  const straight_m = between(fix.xyM, goal_m);
  if ((way?.length_m ?? straight_m) <= THERE_M) return t("{{name}}: you are there", { name });
  const told = { name, distance: within(straight_m), towards: direction(fix, goal_m) };
  if (!way) return t("{{name}}: {{distance}} in a straight line, {{towards}}; nobody walked all the way", told);
  const first = direction(fix, pointAlong(way.line, AHEAD_M));
  if (way.length_m <= STRAIGHT * straight_m && first === told.towards) return t("{{name}}: {{distance}}, {{towards}}", told);
  return t("{{name}}: {{distance}}, {{towards}}; along walked ground {{along}}, first {{first}}", { ...told, along: within(way.length_m), first });
}

/** As the walker faces, or on the map where that is not known. @param {Fix} fix @param {Point} to_m */
function direction({ xyM, headingRad }, to_m) {
  const [x, y] = /** @type {Point} */ (xyM);
  const bearing_rad = Math.atan2(to_m[1] - y, to_m[0] - x);
  if (!Number.isFinite(headingRad)) return t("{{towards}} on the map", { towards: mapTowards(bearing_rad) });
  const eighth = Math.round((4 * (bearing_rad - headingRad)) / Math.PI);
  return TURNS[((eighth % 8) + 8) % 8];
}

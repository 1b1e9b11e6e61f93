/** A floor map in the page, and what is known of its spots. */

import { ELF_SIZE } from "./constants.js";
import { marked } from "../shared/marked.js";

/**
 * @typedef {{
 *   xyM: Float32Array, headingRad: Float32Array, covarianceM2: Float32Array, weight?: Float32Array,
 *   vectors: Float32Array, encoder: string, parameters: MapParameters,
 * }} FloorMap xyM (m, 2); covarianceM2 (m, 3): xx, xy, yy; vectors (m, 128): the stored means, as they
 *   are; parameters: groups as elfslam names them
 * @typedef {{
 *   chirp: import("./chirp.js").ChirpParameters,
 *   echo: import("./echo_arrivals.js").EchoParameters,
 *   locate: import("./locate.js").LocateParameters,
 *   medium_access: import("./hearing.js").MediumAccessParameters,
 *   motion: import("./motion/filters.js").MotionParameters,
 *   spoofing: import("./spoofing.js").SpoofingParameters,
 *   track: import("./track.js").TrackParameters,
 * }} MapParameters
 */

/** @param {FloorMap} floorMap @returns {number} how many spots it has */
function spotCount(floorMap) {
  return floorMap.headingRad.length;
}

/**
 * The map itself, if its parts belong together. Throws RangeError in one line.
 * @param {FloorMap} floorMap
 * @returns {FloorMap}
 */
export function checkedMap(floorMap) {
  const count = spotCount(floorMap);
  if (count === 0) throw new RangeError(marked("map: it has no spots; map the place with sound first"));
  /** @type {[string, Float32Array, number][]} */
  const wanted = [
    ["xyM", floorMap.xyM, 2],
    ["headingRad", floorMap.headingRad, 1],
    ["covarianceM2", floorMap.covarianceM2, 3],
    ["vectors", floorMap.vectors, ELF_SIZE],
  ];
  for (const [name, values, width] of wanted) {
    if (values.length !== count * width) {
      throw new RangeError(
        `map: wanted ${width} numbers of ${name} for each of ${count} spots, ` +
          `got ${values.length}; fetch the map again`,
      );
    }
  }
  return floorMap;
}

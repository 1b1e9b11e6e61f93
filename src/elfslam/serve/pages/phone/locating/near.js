/** The floors around the phone: the server is asked once, by where the phone believes itself to be. */

import { Problem, ask } from "../../shared/api.js";
import { inSentence, t } from "../../shared/words.js";

const PATIENCE = { enableHighAccuracy: true, timeout: 20_000, maximumAge: 60_000 };
/** Browsers tell the radius that holds 95 % of a plane's Gaussian: so many sigmas. */
const SIGMAS = Math.sqrt(-2 * Math.log(0.05));
const [LEAST_M, MOST_M] = [1, 2000];
const NOT_ALLOWED = 1;

export const NO_POSITION = t("This browser tells no page where the phone is. Choose the place from the list.");
export const REFUSED =
  t("The page may not know where the phone is: allow it in the browser's settings, or choose from the list.");
export const LOST = t("The phone does not know where it is. Go near a window and try again, or choose from the list.");
export const NOTHING_NEAR =
  t("No map of a place near here is published. Choose from the list, or walk through the place to map it.");

/** @typedef {{id: string, name: string, revision: number, venue: string, floor: string}} NearMap */

/**
 * The published floors around the phone, the likeliest first.
 * @param {Geolocation | undefined} geolocation @returns {Promise<NearMap[]>} Raises Problem.
 */
export async function floorsNear(geolocation) {
  const position = await positionBy(geolocation);
  const floors = floorsOf(await ask("POST", "/api/find", questionOf(position)));
  if (floors.length === 0) throw new Problem(NOTHING_NEAR, 0);
  return floors;
}

/**
 * What the server is asked. The altitude stays here: browsers count it from another zero than maps do.
 * @param {{coords: {latitude: number, longitude: number, accuracy: number}}} position
 */
export function questionOf({ coords: { latitude, longitude, accuracy } }) {
  const sigma = Math.min(Math.max(accuracy / SIGMAS, LEAST_M), MOST_M);
  return { position: { latitude_deg: latitude, longitude_deg: longitude, sigma_m: sigma } };
}

/**
 * @param {{candidates: {building: string, floor: number, map: string, revision: number}[]}} answer
 * @returns {NearMap[]}
 */
function floorsOf({ candidates }) {
  return candidates.map(({ building, floor, map, revision }) => {
    const name = floorName(floor);
    return { id: map, name: `${building}, ${inSentence(name)}`, revision, venue: building, floor: name };
  });
}

/** As maps on floors of published buildings tell it. @param {number} level */
function floorName(level) {
  return level === 0 ? t("Ground floor") : t("Floor {{level}}", { level });
}

/** @param {Geolocation | undefined} geolocation @returns {Promise<GeolocationPosition>} */
function positionBy(geolocation) {
  if (!geolocation) throw new Problem(NO_POSITION, 0);
  return new Promise((resolve, reject) => {
    /** @param {GeolocationPositionError} error */
    const failed = ({ code }) => reject(new Problem(code === NOT_ALLOWED ? REFUSED : LOST, 0));
    geolocation.getCurrentPosition(resolve, failed, PATIENCE);
  });
}

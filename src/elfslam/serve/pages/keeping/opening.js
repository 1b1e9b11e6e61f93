/** A kept map, checked once more and made ready for locating. */

import { Problem } from "../shared/api.js";
import { sha256Hex } from "./bytes.js";
import { verified } from "./manifest.js";
import { DAMAGED, NOT_HERE } from "./refusals.js";
import { spotsOf } from "./tiles.js";

/**
 * @typedef {import("./manifest.js").Manifest} Manifest
 * @typedef {import("./manifest.js").Part} Part
 * @typedef {import("./manifest.js").Plan} Plan
 * @typedef {import("./store.js").Store} Store
 * @typedef {import("./tiles.js").Spots & {
 *   encoder: string, parameters: import("../stages/floor_map.js").MapParameters,
 * }} FloorMap
 * @typedef {{
 *   map: string, name: string, revision: number, madeUtc: string, spots: number,
 *   tiles: {square: [number, number], spots: number}[],
 *   floorPlan: null | {bytes: Uint8Array<ArrayBuffer>, type: string, widthPx: number, heightPx: number,
 *     placement: Plan["placement"]},
 *   pointsOfInterest: import("../shared/map/points_of_interest.js").PointOfInterest[],
 * }} Facts
 * @typedef {{floorMap: FloorMap, encoderBytes: Uint8Array<ArrayBuffer>, facts: Facts}} Opened
 */

/**
 * @param {Store} store @param {string} name of the kept manifest
 * @param {string} prefix of the names of parts @param {string} mapId
 * @returns {Promise<Opened>} Raises Problem where it is not here or not whole.
 */
export async function opened(store, name, prefix, mapId) {
  /** @type {import("./packages.js").Kept | undefined} */
  const kept = await store.read(name);
  if (kept === undefined) throw new Problem(NOT_HERE, 0);
  try {
    return await readAll(store, prefix, await verified(kept, kept.spki, mapId));
  } catch (error) {
    const now = await store.read(name);
    if (now?.manifest === kept.manifest) throw error;
    return opened(store, name, prefix, mapId); // it was brought up to date while we read
  }
}

/** @param {Store} store @param {string} prefix @param {Manifest} manifest @returns {Promise<Opened>} */
async function readAll(store, prefix, manifest) {
  /** @param {Part} part */
  const bytesOf = (part) => wholePart(store, prefix + part.sha256, part.sha256);
  const tiles = [];
  for (const tile of manifest.tiles) tiles.push(await bytesOf(tile));
  const stretches = [];
  for (const part of manifest.features) stretches.push({ walk: part.walk, bytes: await bytesOf(part) });
  const spots = spotsOf(tiles, stretches);
  const floorMap = {
    ...spots,
    encoder: manifest.encoder.identity,
    parameters: manifest.parameters,
  };
  const facts = {
    map: manifest.map,
    name: manifest.name,
    revision: manifest.revision,
    madeUtc: manifest.made_utc,
    spots: spots.headingRad.length,
    tiles: manifest.tiles.map(({ square, spots: count }) => ({ square, spots: count })),
    floorPlan: manifest.floor_plan ? await planOf(manifest.floor_plan, bytesOf) : null,
    pointsOfInterest: manifest.points_of_interest ?? [],
  };
  return { floorMap, encoderBytes: await bytesOf(manifest.encoder), facts };
}

/** @param {Plan} plan @param {(part: Part) => Promise<Uint8Array<ArrayBuffer>>} bytesOf */
async function planOf(plan, bytesOf) {
  const { type, width_px: widthPx, height_px: heightPx, placement } = plan;
  return { bytes: await bytesOf(plan), type, widthPx, heightPx, placement };
}

/**
 * A damaged part is dropped, so that the next update fetches it.
 * @param {Store} store @param {string} name @param {string} sha256
 */
async function wholePart(store, name, sha256) {
  /** @type {Uint8Array<ArrayBuffer> | undefined} */
  const bytes = await store.read(name);
  if (bytes !== undefined && (await sha256Hex(bytes)) === sha256) return bytes;
  if (bytes !== undefined) await store.remove([name]);
  throw new Problem(DAMAGED, 0);
}

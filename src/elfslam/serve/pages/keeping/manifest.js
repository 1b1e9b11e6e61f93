/** What the server says of a map, believed only where it is signed by the key that was scanned. */

import { Problem } from "../shared/api.js";
import { fromBase64, sha256, toBase64Url } from "./bytes.js";
import { OTHER_MAP, UNKNOWN_FORMAT, WRONG_KEY, WRONG_SIGNATURE } from "./refusals.js";

const FORMAT = 3;
const CURVE = { name: "ECDSA", namedCurve: "P-256" };
const SIGNING = { name: "ECDSA", hash: "SHA-256" };

/**
 * @typedef {{sha256: string, size_bytes: number}} Part
 * @typedef {{
 *   format: number, map: string, name: string, venue?: string, floor?: string, revision: number, made_utc: string,
 *   encoder: Part & {identity: string}, parameters: import("../stages/floor_map.js").MapParameters,
 *   tiles: (Part & {spots: number, square: [number, number]})[], features: (Part & {spots: number, walk: number})[],
 *   floor_plan?: Plan, points_of_interest?: import("../shared/map/points_of_interest.js").PointOfInterest[],
 * }} Manifest
 * @typedef {Part & {type: string, width_px: number, height_px: number,
 *   placement: import("../shared/map/placement.js").Placement | null}} Plan
 * @typedef {{manifest: string, signature: string}} Signed the exact text, and base64 of r and s
 */

/**
 * The server's public key, if it is the one whose digest was scanned. Raises Problem.
 * @param {string} spki base64 @param {string} key base64url of its SHA-256
 */
export async function trustedKey(spki, key) {
  const bytes = fromBase64(spki);
  if (toBase64Url(await sha256(bytes)) !== key) throw new Problem(WRONG_KEY, 0);
  return bytes;
}

/**
 * A manifest whose signature holds and that is of this map. Raises Problem.
 * @param {Signed} signed @param {Uint8Array<ArrayBuffer>} spki @param {string} mapId @returns {Promise<Manifest>}
 */
export async function verified({ manifest, signature }, spki, mapId) {
  if (!(await isSigned(manifest, signature, spki))) throw new Problem(WRONG_SIGNATURE, 0);
  const told = JSON.parse(manifest);
  if (told.format !== FORMAT) throw new Problem(UNKNOWN_FORMAT, 0);
  if (told.map !== mapId) throw new Problem(OTHER_MAP, 0);
  return told;
}

/** @param {string} text @param {string} signature base64 @param {Uint8Array<ArrayBuffer>} spki */
async function isSigned(text, signature, spki) {
  try {
    const key = await crypto.subtle.importKey("spki", spki, CURVE, false, ["verify"]);
    return await crypto.subtle.verify(SIGNING, key, fromBase64(signature), new TextEncoder().encode(text));
  } catch {
    return false; // neither a key nor a signature, or no text at all
  }
}

/** All that a manifest names. @param {Manifest} manifest @returns {Part[]} */
export function partsOf(manifest) {
  const plan = manifest.floor_plan ? [manifest.floor_plan] : [];
  return [...manifest.tiles, ...manifest.features, manifest.encoder, ...plan];
}

/** Maps on this phone: fetched by parts, only what changed, believed only where the server signed it. */

import { NO_ANSWER, Problem, problemOf } from "../shared/api.js";
import { t } from "../shared/words.js";
import { pinnedKey } from "./store.js";
import { numbersOf, spotsOf } from "./tiles.js";

const MAP = "map/";
const PART = "part/";
const AT_ONCE = 4;
const MOST_WAITS = 20;

/**
 * @typedef {Signed & {spki: Uint8Array<ArrayBuffer>}} Kept a signed manifest and the key
 *   that signed it
 * @typedef {{map: string, name: string, venue: string | null, floor: string | null, revision: number, madeUtc: string,
 *   spots: number, sizeBytes: number, isOnPlan: boolean, floors: OtherFloor[]}} Held isOnPlan: a floor plan came with
 *   it, and lies in place; floors: the others of its building
 * @typedef {{revision: number, changed: boolean, parts: number, fetchedParts: number, fetchedBytes: number,
 *   sizeBytes: number}} Updated
 * @typedef {{doneBytes: number, totalBytes: number}} Progress of what has to be fetched
 * @typedef {(path: string) => Promise<Response>} Ask
 * @typedef {import("./store.js").Store} Store
 * @typedef {{
 *   list: () => Promise<Held[]>,
 *   update: (mapId: string, onProgress?: (progress: Progress) => void) => Promise<Updated>,
 *   open: (mapId: string) => Promise<Opened>,
 *   ground: (mapId: string) => Promise<WalkedFloor | null>,
 *   remove: (mapId: string) => Promise<void>,
 * }} Packages all raise Problem with one line for people
 */

/** @param {Store} store @param {Ask} [ask] @returns {Packages} */
export function openPackages(store, ask = askServer) {
  return {
    list: () => list(store),
    update: (mapId, onProgress = () => {}) => store.alone(() => update(store, ask, mapId, onProgress)),
    open: (mapId) => opened(store, MAP + mapId, PART, mapId),
    ground: (mapId) => ground(store, mapId),
    remove: (mapId) => store.alone(() => remove(store, mapId)),
  };
}

/** @param {Store} store @returns {Promise<Held[]>} */
async function list(store) {
  const kept = await manifests(store);
  return kept.map((told) => ({
    map: told.map,
    name: told.name,
    venue: told.venue ?? null,
    floor: told.floor ?? null,
    revision: told.revision,
    madeUtc: told.made_utc,
    spots: told.tiles.reduce((sum, tile) => sum + tile.spots, 0),
    sizeBytes: sizeOf(partsOf(told)),
    isOnPlan: Boolean(told.floor_plan?.placement),
    floors: told.floors ?? [],
  }));
}

/**
 * @param {Store} store @param {Ask} ask @param {string} mapId @param {(progress: Progress) => void} onProgress
 * @returns {Promise<Updated>}
 */
async function update(store, ask, mapId, onProgress) {
  const key = await pinnedKey(store);
  if (key === null) throw new Problem(NO_KEY, 0);
  /** @type {Signed} */
  const signed = await read(ask, `/api/maps/${encodeURIComponent(mapId)}/package`);
  const spki = await trustedKey((await read(ask, "/api/key")).spki, key);
  const manifest = await verified(signed, spki, mapId);
  /** @type {Kept | undefined} */
  const before = await store.read(MAP + mapId);
  refuseOlder(before, signed, manifest);
  const parts = unique(partsOf(manifest));
  const names = new Set(await store.names());
  const lacking = parts.filter((part) => !names.has(PART + part.sha256));
  await fetchAll(store, ask, mapId, lacking, onProgress);
  const { manifest: text, signature } = signed;
  await store.write(MAP + mapId, { manifest: text, signature, spki });
  await sweep(store);
  return {
    revision: manifest.revision,
    changed: before?.manifest !== text,
    parts: parts.length,
    fetchedParts: lacking.length,
    fetchedBytes: sizeOf(lacking),
    sizeBytes: sizeOf(parts),
  };
}

/**
 * @param {Kept | undefined} before @param {Signed} signed
 * @param {Manifest} manifest
 */
function refuseOlder(before, signed, manifest) {
  if (before === undefined || before.manifest === signed.manifest) return;
  if (!(manifest.revision > JSON.parse(before.manifest).revision)) throw new Problem(OLDER, 0);
}

/**
 * Each part is kept as soon as it is known to be right: what was cut off goes on where it was.
 * @param {Store} store @param {Ask} ask @param {string} mapId @param {Part[]} parts
 * @param {(progress: Progress) => void} onProgress
 */
async function fetchAll(store, ask, mapId, parts, onProgress) {
  const totalBytes = sizeOf(parts);
  let doneBytes = 0;
  onProgress({ doneBytes, totalBytes });
  const waiting = [...parts];
  const work = async () => {
    for (let part = waiting.shift(); part !== undefined; part = waiting.shift()) {
      await store.write(PART + part.sha256, await fetchPart(ask, mapId, part));
      doneBytes += part.size_bytes;
      onProgress({ doneBytes, totalBytes });
    }
  };
  /** @param {unknown} error */
  const stop = (error) => {
    waiting.length = 0;
    throw error;
  };
  const ends = await Promise.allSettled(Array.from({ length: AT_ONCE }, () => work().catch(stop)));
  const failed = ends.find((end) => end.status === "rejected");
  if (failed) throw failed.reason;
}

/** @param {Ask} ask @param {string} mapId @param {Part} part */
async function fetchPart(ask, mapId, { sha256, size_bytes }) {
  const path = `/api/maps/${encodeURIComponent(mapId)}/package/${encodeURIComponent(sha256)}`;
  const bytes = new Uint8Array(await (await answer(ask, path)).arrayBuffer().catch(noAnswer));
  if (bytes.length !== size_bytes || (await sha256Hex(bytes)) !== sha256) throw new Problem(WRONG_PART, 0);
  return bytes;
}

/** @param {Store} store @param {string} mapId */
async function remove(store, mapId) {
  await store.remove([MAP + mapId]);
  await sweep(store);
}

/** Drop the parts that no map needs any more; maps share what they have in common. @param {Store} store */
async function sweep(store) {
  const needed = new Set((await manifests(store)).flatMap(partsOf).map((part) => PART + part.sha256));
  const names = await store.names();
  await store.remove(names.filter((name) => name.startsWith(PART) && !needed.has(name)));
}

/** @param {Store} store @returns {Promise<Manifest[]>} */
async function manifests(store) {
  const names = (await store.names()).filter((name) => name.startsWith(MAP));
  /** @type {(Kept | undefined)[]} */
  const kept = await Promise.all(names.map((name) => store.read(name)));
  return kept.filter((each) => each !== undefined).map((each) => JSON.parse(each.manifest));
}

/** @param {Part[]} parts */
function unique(parts) {
  return [...new Map(parts.map((part) => [part.sha256, part])).values()];
}

/** @param {Part[]} parts */
function sizeOf(parts) {
  return unique(parts).reduce((sum, part) => sum + part.size_bytes, 0);
}

/** @type {Ask} */
function askServer(path) {
  return fetch(path, { headers: { Accept: "application/json, application/octet-stream" } });
}

/** @param {Ask} ask @param {string} path */
async function read(ask, path) {
  return (await answer(ask, path)).json().catch(noAnswer);
}

/** The server's answer; waits where it asks for patience. Raises Problem. @param {Ask} ask @param {string} path */
async function answer(ask, path) {
  for (let waits = 0; ; waits += 1) {
    const response = await ask(path).catch(noAnswer);
    if (response.ok) return response;
    if (response.status !== 429 || waits === MOST_WAITS) throw await problemOf(response);
    const seconds = Number(response.headers.get("Retry-After")) || 1;
    await new Promise((resolve) => setTimeout(resolve, 1000 * seconds));
  }
}

/** @returns {never} */
function noAnswer() {
  throw new Problem(NO_ANSWER, 0);
}

// A kept map, checked once more and made ready for locating.

/**
 * @typedef {import("./tiles.js").Spots & {
 *   encoder: string, parameters: import("../stages/floor_map.js").MapParameters,
 * }} FloorMap
 * @typedef {{
 *   map: string, name: string, revision: number, madeUtc: string, spots: number,
 *   tiles: {square: [number, number], spots: number}[],
 *   floorPlan: null | {bytes: Uint8Array<ArrayBuffer>, type: string, widthPx: number, heightPx: number,
 *     placement: Plan["placement"]},
 *   pointsOfInterest: import("../shared/map/points_of_interest.js").PointOfInterest[],
 *   level: number, passages: import("../stages/ways.js").Passage[], floors: OtherFloor[],
 * }} Facts level: 0 where no building tells it
 * @typedef {Pick<Facts, "map" | "name" | "level" | "passages" | "pointsOfInterest"> & {xyM: Float32Array}} WalkedFloor
 * @typedef {{floorMap: FloorMap, encoderBytes: Uint8Array<ArrayBuffer>, facts: Facts}} Opened
 */

/**
 * @param {Store} store @param {string} name of the kept manifest
 * @param {string} prefix of the names of parts @param {string} mapId
 * @returns {Promise<Opened>} Raises Problem where it is not here or not whole.
 */
export async function opened(store, name, prefix, mapId) {
  /** @type {Kept | undefined} */
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
    ...joinedBy(manifest),
  };
  return { floorMap, encoderBytes: await bytesOf(manifest.encoder), facts };
}

/** What ways need of a floor; null where it is not on this phone, or not whole. @param {Store} store @param {string} mapId
 * @returns {Promise<WalkedFloor | null>} */
async function ground(store, mapId) {
  /** @type {Kept | undefined} */
  const kept = await store.read(MAP + mapId);
  if (kept === undefined) return null;
  try {
    const manifest = await verified(kept, kept.spki, mapId);
    const tiles = [];
    for (const { sha256 } of manifest.tiles) tiles.push(await wholePart(store, PART + sha256, sha256));
    return { map: mapId, name: manifest.name, xyM: numbersOf(tiles).xyM, ...joinedBy(manifest) };
  } catch {
    return null; // ways lead over the other floors alone
  }
}

/** @param {Manifest} manifest */
function joinedBy({ level = 0, passages = [], floors = [], points_of_interest: pointsOfInterest = [] }) {
  return { level, passages, floors, pointsOfInterest };
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

// What the server says of a map, believed only where it is signed by the key that was scanned.

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
 *   level?: number, passages?: import("../stages/ways.js").Passage[], floors?: OtherFloor[],
 * }} Manifest
 * @typedef {{level: number, map: string}} OtherFloor another map of the building
 * @typedef {Part & {type: string, width_px: number, height_px: number,
 *   placement: import("../shared/map/placement.js").Placement | null}} Plan
 * @typedef {{manifest: string, signature: string}} Signed the exact text, and base64 of r and s
 */

/**
 * The server's public key, if it is the one whose digest was scanned. Raises Problem.
 * @param {string} spki base64 @param {string} key base64url of its SHA-256
 */
async function trustedKey(spki, key) {
  const bytes = fromBase64(spki);
  if (toBase64Url(await sha256(bytes)) !== key) throw new Problem(WRONG_KEY, 0);
  return bytes;
}

/**
 * A manifest whose signature holds and that is of this map. Raises Problem.
 * @param {Signed} signed @param {Uint8Array<ArrayBuffer>} spki @param {string} mapId @returns {Promise<Manifest>}
 */
async function verified({ manifest, signature }, spki, mapId) {
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
function partsOf(manifest) {
  const plan = manifest.floor_plan ? [manifest.floor_plan] : [];
  return [...manifest.tiles, ...manifest.features, manifest.encoder, ...plan];
}

// Bytes as text, and what they are known by.

/** @param {string} text base64 or base64url, with or without padding @returns {Uint8Array<ArrayBuffer>} */
function fromBase64(text) {
  const plain = text.replaceAll("-", "+").replaceAll("_", "/");
  return Uint8Array.from(atob(plain), (letter) => letter.charCodeAt(0));
}

/** @param {Uint8Array} bytes @returns {string} as addresses carry it: base64url without padding */
function toBase64Url(bytes) {
  const plain = btoa(String.fromCharCode(...bytes));
  return plain.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** @param {Uint8Array} bytes @returns {string} hexadecimal */
function toHex(bytes) {
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** @param {BufferSource} bytes @returns {Promise<Uint8Array<ArrayBuffer>>} */
export async function sha256(bytes) {
  return new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
}

/** @param {BufferSource} bytes @returns {Promise<string>} hexadecimal */
async function sha256Hex(bytes) {
  return toHex(await sha256(bytes));
}

// Why a map is not taken, in one line each. What the phone held before stays as it was.

export const NO_KEY = t("This phone does not know the server's key yet. Scan the code that the server shows, once more.");
export const WRONG_KEY = t("The server's key is not the one of the code that this phone scanned. The map was not taken.");
export const WRONG_SIGNATURE = t("The map is not signed by the server's key. It was not taken.");
export const OTHER_MAP = t("The server sent another map than the one that was asked for. It was not taken.");
export const OLDER = t("The server sent an older state of the map than this phone has. It was not taken.");
const UNKNOWN_FORMAT =
  t("The map is in another format than this page reads. Reload the page while the server is there, and fetch the map again.");
export const WRONG_PART = t("A part of the map is not what the server signed. The map was not taken; try again.");
export const NOT_HERE = t("This map is not on this phone. Fetch it while the server is there.");
export const DAMAGED = t("What this phone kept of the map is damaged. Fetch it again while the server is there.");

/** Maps on this phone: fetched by parts, only what changed, believed only where the server signed it. */

import { NO_ANSWER, Problem, problemOf } from "../shared/api.js";
import { sha256Hex } from "./bytes.js";
import { partsOf, trustedKey, verified } from "./manifest.js";
import { opened } from "./opening.js";
import { pinnedKey } from "./pairing.js";
import { NO_KEY, OLDER, WRONG_PART } from "./refusals.js";

const MAP = "map/";
const PART = "part/";
const AT_ONCE = 4;
const MOST_WAITS = 20;

/**
 * @typedef {import("./manifest.js").Signed & {spki: Uint8Array<ArrayBuffer>}} Kept a signed manifest and the key
 *   that signed it
 * @typedef {{map: string, name: string, venue: string | null, floor: string | null, revision: number, madeUtc: string,
 *   spots: number, sizeBytes: number, isOnPlan: boolean}} Held isOnPlan: a floor plan came with it, and lies in place
 * @typedef {{revision: number, changed: boolean, parts: number, fetchedParts: number, fetchedBytes: number,
 *   sizeBytes: number}} Updated
 * @typedef {{doneBytes: number, totalBytes: number}} Progress of what has to be fetched
 * @typedef {(path: string) => Promise<Response>} Ask
 * @typedef {import("./manifest.js").Part} Part
 * @typedef {import("./store.js").Store} Store
 * @typedef {{
 *   list: () => Promise<Held[]>,
 *   update: (mapId: string, onProgress?: (progress: Progress) => void) => Promise<Updated>,
 *   open: (mapId: string) => Promise<import("./opening.js").Opened>,
 *   remove: (mapId: string) => Promise<void>,
 * }} Packages all raise Problem with one line for people
 */

/** @param {Store} store @param {Ask} [ask] @returns {Packages} */
export function openPackages(store, ask = askServer) {
  return {
    list: () => list(store),
    update: (mapId, onProgress = () => {}) => store.alone(() => update(store, ask, mapId, onProgress)),
    open: (mapId) => opened(store, MAP + mapId, PART, mapId),
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
  }));
}

/**
 * @param {Store} store @param {Ask} ask @param {string} mapId @param {(progress: Progress) => void} onProgress
 * @returns {Promise<Updated>}
 */
async function update(store, ask, mapId, onProgress) {
  const key = await pinnedKey(store);
  if (key === null) throw new Problem(NO_KEY, 0);
  /** @type {import("./manifest.js").Signed} */
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
 * @param {Kept | undefined} before @param {import("./manifest.js").Signed} signed
 * @param {import("./manifest.js").Manifest} manifest
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

/** @param {Store} store @returns {Promise<import("./manifest.js").Manifest[]>} */
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

/**
 * Where maps are kept: values by name, in IndexedDB, so that they survive a restart of the browser.
 *
 * @typedef {{
 *   read: (name: string) => Promise<any>,
 *   write: (name: string, value: any) => Promise<void>,
 *   remove: (names: string[]) => Promise<void>,
 *   names: () => Promise<string[]>,
 *   alone: <T>(work: () => Promise<T>) => Promise<T>,
 * }} Store `read` gives undefined where nothing is; `alone` lets nobody else change maps meanwhile
 */

const DATABASE = "elfslam-maps";
const VALUES = "values";

/** @param {string} [name] of the database @returns {Promise<Store>} */
export async function openStore(name = DATABASE) {
  const opening = indexedDB.open(name, 1);
  opening.onupgradeneeded = () => opening.result.createObjectStore(VALUES);
  const database = await settled(opening);
  const reading = () => database.transaction(VALUES).objectStore(VALUES);
  return {
    read: (key) => settled(reading().get(key)),
    names: () => /** @type {Promise<string[]>} */ (settled(reading().getAllKeys())),
    write: (key, value) => changed(database, (values) => values.put(value, key)),
    remove: (keys) => changed(database, (values) => keys.forEach((key) => values.delete(key))),
    alone: (work) => (navigator.locks ? navigator.locks.request(name, work) : work()),
  };
}

/**
 * Ends when the change is on the disk.
 * @param {IDBDatabase} database @param {(values: IDBObjectStore) => void} change @returns {Promise<void>}
 */
function changed(database, change) {
  return new Promise((resolve, reject) => {
    const transaction = database.transaction(VALUES, "readwrite", { durability: "strict" });
    transaction.oncomplete = () => resolve();
    transaction.onabort = () => reject(transaction.error);
    change(transaction.objectStore(VALUES));
  });
}

/** @template T @param {IDBRequest<T>} request @returns {Promise<T>} */
export function settled(request) {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
}

// Whom this phone belongs to, and the key that it trusts: kept when the server's code is scanned.

const PAIRING = "pairing";
/** Nobody: a link opened a map here, and no account was ever paired. */
const GUEST = "";
const KEY = /^[A-Za-z0-9_-]{43}$/;

/** @typedef {{user: string, key: string | null}} Pairing */

/** @param {Store} store @returns {Promise<string | null>} the digest of the key */
export async function pinnedKey(store) {
  return (await store.read(PAIRING))?.key ?? null;
}

/**
 * Trust the key that an address names; what somebody else kept here is forgotten, what a guest kept stays.
 * @param {Store} store @param {string} fragment @param {string} user their id
 */
export async function pair(store, fragment, user) {
  const before = await store.read(PAIRING);
  const isOther = before && before.user !== GUEST && before.user !== user;
  if (isOther) await store.remove(await store.names());
  const known = before && !isOther ? before.key : null;
  await store.write(PAIRING, { user, key: keyIn(fragment) ?? known });
}

/**
 * Trust the key that a link names, where this phone trusts none yet.
 * @param {Store} store @param {string} fragment
 */
export async function trustAsGuest(store, fragment) {
  const before = await store.read(PAIRING);
  if (!before?.key) await store.write(PAIRING, { user: before?.user ?? GUEST, key: keyIn(fragment) });
}

/** @param {string} fragment such as "#token=abc&key=def" @returns {string | null} */
export function keyIn(fragment) {
  const key = new URLSearchParams(fragment.replace(/^#/, "")).get("key");
  return key !== null && KEY.test(key) ? key : null;
}

/** Pair this browser; one that keeps nothing is no reason to stop. @param {string} fragment @param {string} user */
export async function pairHere(fragment, user) {
  if (!globalThis.indexedDB) return;
  try {
    await pair(await openStore(), fragment, user);
  } catch (error) {
    console.warn("This browser keeps no maps.", error);
  }
}

/** Forget all maps, the key, and whom they belonged to. */
export async function forgetHere() {
  if (!globalThis.indexedDB) return;
  const store = await openStore();
  await store.alone(async () => store.remove(await store.names()));
}

// Maps that this phone may use by a link: remembered, so that they are listed again without an account.

const LINK = "link/";

/** @typedef {{map: string, name: string, venue: string | null, floor: string | null, created_utc: string,
 *   owner: string}} LinkedMap
 */

/** @param {Store} store @param {LinkedMap} linked */
export async function rememberLink(store, linked) {
  await store.write(LINK + linked.map, linked);
}

/** @param {Store} store @param {string} mapId */
export async function forgetLink(store, mapId) {
  await store.remove([LINK + mapId]);
}

/** @param {Store} store @returns {Promise<LinkedMap[]>} */
export async function linkedMaps(store) {
  const names = (await store.names()).filter((name) => name.startsWith(LINK));
  const found = await Promise.all(names.map((name) => store.read(name)));
  return found.filter((each) => each !== undefined);
}

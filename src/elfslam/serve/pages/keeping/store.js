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

/** The same in memory. @returns {Store} */
export function memoryStore() {
  const kept = new Map();
  /** @type {Promise<unknown>} */
  let last = Promise.resolve();
  return {
    read: async (key) => kept.get(key),
    names: async () => [...kept.keys()],
    write: async (key, value) => void kept.set(key, value),
    remove: async (keys) => keys.forEach((key) => kept.delete(key)),
    alone: (work) => {
      const worked = last.catch(() => {}).then(work);
      last = worked;
      return worked;
    },
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
function settled(request) {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
}

/** The same shelf in IndexedDB, for browsers without a file system: files as runs of pieces. */

const DATABASE = "elfslam";
const PIECES = "pieces";

/** @returns {Promise<import("./shelf_files.js").Shelf>} */
export async function openDatabaseShelf() {
  const opening = indexedDB.open(DATABASE, 1);
  opening.onupgradeneeded = () => opening.result.createObjectStore(PIECES);
  const database = await settled(opening);
  const store = (mode) => database.transaction(PIECES, mode, { durability: "strict" }).objectStore(PIECES);
  const keys = (range) => settled(store("readonly").getAllKeys(range));
  return {
    walks: async () => unique((await keys()).map(([walk]) => walk)),
    names: async (walk) => unique((await keys(allOf(walk))).map(([, name]) => name)),
    open: async (walk, name) => keptAs(store, walk, name, await sizeOf(store, walk, name)),
    remove: (walk) => settled(store("readwrite").delete(allOf(walk))),
  };
}

function keptAs(store, walk, name, size) {
  const kept = {
    size,
    append: async (bytes) => {
      if (bytes.length === 0) return;
      await settled(store("readwrite").put(bytes.slice(), [walk, name, kept.size]));
      kept.size += bytes.length;
    },
    replace: async (bytes) => {
      const within = store("readwrite");
      within.delete(allOf(walk, name));
      await settled(within.put(bytes.slice(), [walk, name, 0]));
      kept.size = bytes.length;
    },
    truncate: async (wanted) => kept.replace(await kept.read(0, wanted)),
    read: async (start, end) => joined(await piecesOf(store, walk, name), start, end),
    flush: async () => {},
    close: () => {},
  };
  return kept;
}

async function piecesOf(store, walk, name) {
  const within = store("readonly");
  const range = allOf(walk, name);
  const [keys, pieces] = await Promise.all([
    settled(within.getAllKeys(range)),
    settled(within.getAll(range)),
  ]);
  return keys.map(([, , start], k) => ({ start, bytes: pieces[k] }));
}

async function sizeOf(store, walk, name) {
  const pieces = await piecesOf(store, walk, name);
  return pieces.length === 0 ? 0 : pieces.at(-1).start + pieces.at(-1).bytes.length;
}

/** Bytes [start, end) of pieces that follow each other. */
export function joined(pieces, start, end) {
  const out = new Uint8Array(end - start);
  for (const piece of pieces) {
    const from = Math.max(start - piece.start, 0);
    const to = Math.min(end - piece.start, piece.bytes.length);
    if (from < to) out.set(piece.bytes.subarray(from, to), piece.start + from - start);
  }
  return out;
}

function allOf(...path) {
  return IDBKeyRange.bound(path, [...path, []]);
}

function unique(names) {
  return [...new Set(names)];
}

function settled(request) {
  return new Promise((resolve, reject) => {
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
}

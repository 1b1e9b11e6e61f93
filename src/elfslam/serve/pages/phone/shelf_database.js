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

/** No piece is longer: what a read or a cut has to look at. */
const LONGEST_PIECE = 1 << 16;

function keptAs(store, walk, name, size) {
  const within = (start) => IDBKeyRange.bound([walk, name, start], [walk, name, []]);
  const put = (bytes, start) => settled(store("readwrite").put(bytes.slice(), [walk, name, start]));
  const kept = {
    size,
    append: async (bytes) => {
      for (let at = 0; at < bytes.length; at += LONGEST_PIECE) {
        const piece = bytes.subarray(at, at + LONGEST_PIECE);
        await put(piece, kept.size);
        kept.size += piece.length;
      }
    },
    replace: async (bytes) => {
      await settled(store("readwrite").delete(within(0)));
      kept.size = 0;
      await kept.append(bytes);
    },
    truncate: async (wanted) => {
      const start = Math.max(wanted - LONGEST_PIECE, 0);
      const tail = await kept.read(start, wanted);
      await settled(store("readwrite").delete(within(start)));
      const pieces = await piecesOf(store, within(0));
      const end = pieces.length === 0 ? 0 : pieces.at(-1).start + pieces.at(-1).bytes.length;
      kept.size = end;
      await kept.append(tail.subarray(end - start));
    },
    read: async (start, end) =>
      joined(await piecesOf(store, within(Math.max(start - LONGEST_PIECE, 0)), end), start, end),
    flush: async () => {},
    close: () => {},
  };
  return kept;
}

async function piecesOf(store, range, end = Infinity) {
  const reading = store("readonly");
  const [keys, pieces] = await Promise.all([
    settled(reading.getAllKeys(range)),
    settled(reading.getAll(range)),
  ]);
  return keys
    .map(([, , start], k) => ({ start, bytes: pieces[k] }))
    .filter((piece) => piece.start < end);
}

async function sizeOf(store, walk, name) {
  const reading = store("readonly").openCursor(allOf(walk, name), "prev");
  const cursor = await settled(reading);
  return cursor === null ? 0 : cursor.key[2] + cursor.value.length;
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

/**
 * Where a walk's bytes are kept: the browser's own file system, a folder per walk.
 *
 * @typedef {{
 *   size: number,
 *   append: (bytes: Uint8Array) => Promise<void>,
 *   replace: (bytes: Uint8Array) => Promise<void>,
 *   truncate: (size: number) => Promise<void>,
 *   read: (start: number, end: number) => Promise<Uint8Array>,
 *   flush: () => Promise<void>,
 *   close: () => void,
 * }} Kept one file
 * @typedef {{
 *   walks: () => Promise<string[]>,
 *   names: (walk: string) => Promise<string[]>,
 *   open: (walk: string, name: string) => Promise<Kept>,
 *   remove: (walk: string) => Promise<void>,
 * }} ByteStore
 */

import { settled } from "../keeping/store.js";

const FOLDER = "walks";

/** @returns {Promise<ByteStore | null>} null where the browser has no such file system */
export async function openOpfsStore() {
  const hasHandles = "createSyncAccessHandle" in (self.FileSystemFileHandle?.prototype ?? {});
  if (!hasHandles) return null;
  try {
    const root = await navigator.storage.getDirectory();
    return storeIn(await root.getDirectoryHandle(FOLDER, { create: true }));
  } catch {
    return null; // private windows of some browsers have the functions and refuse them
  }
}

/** @param {FileSystemDirectoryHandle} folder @returns {ByteStore} */
function storeIn(folder) {
  return {
    walks: () => keysOf(folder),
    names: async (walk) => keysOf(await folder.getDirectoryHandle(walk)),
    open: async (walk, name) => {
      const inside = await folder.getDirectoryHandle(walk, { create: true });
      const file = await inside.getFileHandle(name, { create: true });
      return keptIn(await file.createSyncAccessHandle());
    },
    remove: (walk) => folder.removeEntry(walk, { recursive: true }),
  };
}

/** @param {FileSystemDirectoryHandle} folder */
async function keysOf(folder) {
  const names = [];
  for await (const name of folder.keys()) names.push(name);
  return names;
}

/** @param {FileSystemSyncAccessHandle} handle @returns {Kept} */
function keptIn(handle) {
  /** @param {Uint8Array} bytes @param {number} at */
  const write = (bytes, at) => {
    const written = handle.write(bytes, { at });
    if (written !== bytes.length) {
      handle.truncate(at);
      throw new DOMException("no room", "QuotaExceededError");
    }
  };
  return {
    get size() {
      return handle.getSize();
    },
    append: async (bytes) => write(bytes, handle.getSize()),
    replace: async (bytes) => {
      write(bytes, 0);
      handle.truncate(bytes.length);
      handle.flush();
    },
    truncate: async (size) => handle.truncate(size),
    read: async (start, end) => {
      const bytes = new Uint8Array(end - start);
      handle.read(bytes, { at: start });
      return bytes;
    },
    flush: async () => handle.flush(),
    close: () => handle.close(),
  };
}

/** The same store in IndexedDB, for browsers without a file system: files as runs of pieces. */

const DATABASE = "elfslam";
const PIECES = "pieces";

/**
 * @typedef {(mode: IDBTransactionMode) => IDBObjectStore} Store
 * @typedef {[walk: string, name: string, start: number]} Key of a piece
 * @typedef {{start: number, bytes: Uint8Array}} Piece
 */

/** @returns {Promise<ByteStore>} */
export async function openIdbStore() {
  const opening = indexedDB.open(DATABASE, 1);
  opening.onupgradeneeded = () => opening.result.createObjectStore(PIECES);
  const database = await settled(opening);
  /** @type {Store} */
  const store = (mode) => database.transaction(PIECES, mode, { durability: "strict" }).objectStore(PIECES);
  /** @param {IDBKeyRange} [range] */
  const keys = (range) => /** @type {Promise<Key[]>} */ (settled(store("readonly").getAllKeys(range)));
  return {
    walks: async () => unique((await keys()).map(([walk]) => walk)),
    names: async (walk) => unique((await keys(allOf(walk))).map(([, name]) => name)),
    open: async (walk, name) => keptAs(store, walk, name, await sizeOf(store, walk, name)),
    remove: (walk) => settled(store("readwrite").delete(allOf(walk))),
  };
}

/** No piece is longer: what a read or a cut has to look at. */
const LONGEST_PIECE = 1 << 16;

/**
 * @param {Store} store @param {string} walk @param {string} name @param {number} size
 * @returns {Kept}
 */
function keptAs(store, walk, name, size) {
  /** @param {number} start */
  const within = (start) => IDBKeyRange.bound([walk, name, start], [walk, name, []]);
  /** @param {Uint8Array} bytes @param {number} start */
  const put = (bytes, start) => settled(store("readwrite").put(bytes.slice(), [walk, name, start]));
  /** @type {Kept} */
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
      const last = pieces.at(-1);
      const end = last ? last.start + last.bytes.length : 0;
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

/** @param {Store} store @param {IDBKeyRange} range @returns {Promise<Piece[]>} those that begin before `end` */
async function piecesOf(store, range, end = Infinity) {
  const reading = store("readonly");
  const [keys, pieces] = await Promise.all([
    settled(reading.getAllKeys(range)),
    settled(reading.getAll(range)),
  ]);
  return /** @type {Key[]} */ (keys)
    .map(([, , start], k) => ({ start, bytes: pieces[k] }))
    .filter((piece) => piece.start < end);
}

/** @param {Store} store @param {string} walk @param {string} name */
async function sizeOf(store, walk, name) {
  const reading = store("readonly").openCursor(allOf(walk, name), "prev");
  const cursor = await settled(reading);
  return cursor === null ? 0 : /** @type {Key} */ (cursor.key)[2] + cursor.value.length;
}

/**
 * Bytes [start, end) of pieces that follow each other.
 * @param {Piece[]} pieces @param {number} start @param {number} end
 */
export function joined(pieces, start, end) {
  const out = new Uint8Array(end - start);
  for (const piece of pieces) {
    const from = Math.max(start - piece.start, 0);
    const to = Math.min(end - piece.start, piece.bytes.length);
    if (from < to) out.set(piece.bytes.subarray(from, to), piece.start + from - start);
  }
  return out;
}

/** @param {...string} path */
function allOf(...path) {
  return IDBKeyRange.bound(path, [...path, []]);
}

/** @param {string[]} names */
function unique(names) {
  return [...new Set(names)];
}

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

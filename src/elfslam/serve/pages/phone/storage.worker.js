/**
 * The storage of bytes: everything that is recorded comes here first, and is kept until the server has it.
 * Orders come from the page and from the sound's worker, and are carried out one after the other.
 */

import { marked } from "../shared/marked.js";
import { openIdbStore, openOpfsStore } from "./byte_stores.js";

const STATE = "walk.json";

/**
 * @typedef {import("./byte_stores.js").Kept} Kept
 * @typedef {import("./manifest.js").Walk} Walk
 * @typedef {{walk: string, name: string, parts: [name: string, bytes: Uint8Array][], state: Walk, reserve: number,
 *   start: number, end: number, size: number}} Given what orders are about; each looks at what it needs
 * @typedef {{do: keyof typeof orders, id: number} & Given} Order
 * @typedef {import("./storage_client.js").Answer} Answer
 */

/** @type {Promise<import("./byte_stores.js").ByteStore>} */
const store = openOpfsStore().then((found) => found ?? openIdbStore());
/** @type {Map<string, Kept>} by walk and name */
const open = new Map();

/** @param {string} walk @param {string} name */
async function kept(walk, name) {
  const key = `${walk}/${name}`;
  const file = open.get(key) ?? (await (await store).open(walk, name));
  open.set(key, file);
  return file;
}

/** Those of a walk that are open. @param {string} walk */
function openOf(walk) {
  return [...open].filter(([key]) => key.startsWith(`${walk}/`));
}

/** All parts are kept, or none. @param {Given} given */
async function append({ walk, parts }) {
  /** @type {Record<string, number>} */
  const sizes = {};
  /** @type {[file: Kept, size: number][]} */
  const before = [];
  try {
    for (const [name, bytes] of parts) {
      const file = await kept(walk, name);
      before.push([file, file.size]);
      await file.append(bytes);
      sizes[name] = file.size;
    }
  } catch (error) {
    for (const [file, size] of before) await file.truncate(size);
    throw error;
  }
  self.postMessage({ is: "kept", walk, sizes });
}

/** What is known of each walk: its state, and the sizes of its files. */
async function list() {
  const walks = [];
  for (const walk of await (await store).walks()) {
    const names = (await (await store).names(walk)).filter((name) => name !== STATE);
    /** @type {Record<string, number>} */
    const sizes = {};
    for (const name of names) sizes[name] = (await kept(walk, name)).size;
    walks.push({ walk, state: await readState(walk), sizes });
  }
  return walks;
}

/** @param {string} walk @returns {Promise<Walk | null>} */
async function readState(walk) {
  const file = await kept(walk, STATE);
  try {
    return JSON.parse(new TextDecoder().decode(await file.read(0, file.size)));
  } catch {
    return null;
  }
}

/** @param {Given} given */
async function remove({ walk }) {
  for (const [key, file] of openOf(walk)) {
    file.close();
    open.delete(key);
  }
  await (await store).remove(walk);
}

const orders = {
  append,
  list,
  remove,
  /** @param {Given} given */
  save: async ({ walk, state, reserve }) => {
    const text = JSON.stringify(state) + " ".repeat(reserve);
    await (await kept(walk, STATE)).replace(new TextEncoder().encode(text));
  },
  /** @param {Given} given */
  read: async ({ walk, name, start, end }) => (await kept(walk, name)).read(start, end),
  /** @param {Given} given */
  truncate: async ({ walk, name, size }) => (await kept(walk, name)).truncate(size),
  /** @param {Given} given */
  flush: async ({ walk }) => {
    for (const [, file] of openOf(walk)) await file.flush();
  },
};

let last = Promise.resolve();

/** @param {Order} order @param {(answer: Answer) => void} answer */
function carryOut(order, answer) {
  last = last.then(async () => {
    try {
      answer({ id: order.id, result: await orders[order.do](order) });
    } catch (error) {
      answer({ id: order.id, problem: describe(/** @type {Error} */ (error)) });
    }
  });
}

/** @param {Error | null | undefined} error @returns {import("./storage_client.js").Failure} */
function describe(error) {
  const isFull = error?.name === "QuotaExceededError";
  if (isFull) return { isFull, said: marked("This phone has no room left."), why: "" };
  if (error?.name === "NoModificationAllowedError") {
    const said = marked("This page is open in another tab, which holds the walks. Close that one, and load this one again.");
    return { isFull, said, why: "" };
  }
  return { isFull, said: "", why: String(error?.message ?? error) };
}

self.onmessage = ({ data }) => {
  if (data.do === "serve") {
    const port = /** @type {MessagePort} */ (data.port);
    port.onmessage = ({ data: order }) => carryOut(order, reportProblem);
    return;
  }
  carryOut(data, (answer) => self.postMessage({ is: "answer", ...answer }));
};

/** The sound's worker waits for no answer; what goes wrong there is the page's to know. @param {Answer} answer */
function reportProblem({ problem }) {
  if (problem) self.postMessage({ is: "problem", problem });
}

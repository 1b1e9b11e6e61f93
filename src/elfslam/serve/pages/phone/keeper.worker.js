/**
 * The keeper of bytes: everything that is recorded comes here first, and is kept until the server has it.
 * Orders come from the page and from the sound's worker, and are carried out one after the other.
 */

import { openDatabaseShelf } from "./shelf_database.js";
import { openFileShelf } from "./shelf_files.js";

const STATE = "walk.json";

/** @type {Promise<import("./shelf_files.js").Shelf>} */
const shelf = openFileShelf().then((found) => found ?? openDatabaseShelf());
/** @type {Map<string, import("./shelf_files.js").Kept>} by walk and name */
const open = new Map();

async function kept(walk, name) {
  const key = `${walk}/${name}`;
  if (!open.has(key)) open.set(key, await (await shelf).open(walk, name));
  return open.get(key);
}

/** All parts are kept, or none. */
async function append({ walk, parts }) {
  const sizes = {};
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
  for (const walk of await (await shelf).walks()) {
    const names = (await (await shelf).names(walk)).filter((name) => name !== STATE);
    const sizes = {};
    for (const name of names) sizes[name] = (await kept(walk, name)).size;
    walks.push({ walk, state: await readState(walk), sizes });
  }
  return walks;
}

async function readState(walk) {
  const file = await kept(walk, STATE);
  try {
    return JSON.parse(new TextDecoder().decode(await file.read(0, file.size)));
  } catch {
    return null;
  }
}

async function remove({ walk }) {
  for (const key of [...open.keys()].filter((name) => name.startsWith(`${walk}/`))) {
    open.get(key).close();
    open.delete(key);
  }
  await (await shelf).remove(walk);
}

const orders = {
  append,
  list,
  remove,
  save: async ({ walk, state, reserve }) => {
    const text = JSON.stringify(state) + " ".repeat(reserve);
    await (await kept(walk, STATE)).replace(new TextEncoder().encode(text));
  },
  read: async ({ walk, name, start, end }) => (await kept(walk, name)).read(start, end),
  truncate: async ({ walk, name, size }) => (await kept(walk, name)).truncate(size),
  flush: async ({ walk }) => {
    const mine = [...open.keys()].filter((name) => name.startsWith(`${walk}/`));
    for (const key of mine) await open.get(key).flush();
  },
};

let last = Promise.resolve();

function carryOut(order, answer) {
  last = last.then(async () => {
    try {
      answer({ id: order.id, result: await orders[order.do](order) });
    } catch (error) {
      answer({ id: order.id, problem: describe(error) });
    }
  });
}

function describe(error) {
  const isFull = error?.name === "QuotaExceededError";
  const isElsewhere = error?.name === "NoModificationAllowedError";
  const said = isElsewhere
    ? "This page is open in another tab, which holds the walks. Close that one, and load this one again."
    : `The browser cannot keep the walk (${error?.message ?? error}).`;
  return { isFull, said: isFull ? "This phone has no room left." : said };
}

self.onmessage = ({ data }) => {
  if (data.do === "serve") {
    data.port.onmessage = ({ data: order }) => carryOut(order, reportProblem);
    return;
  }
  carryOut(data, (answer) => self.postMessage({ is: "answer", ...answer }));
};

/** The sound's worker waits for no answer; what goes wrong there is the page's to know. */
function reportProblem({ problem }) {
  if (problem) self.postMessage({ is: "problem", problem });
}

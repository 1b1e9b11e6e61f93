/*
 * Keeps the phone page, so that it opens without its server. The server writes VERSION above this text: it is
 * another one whenever a file of the page is, and the browser then fetches all that changed beside the old page,
 * which stays whole until nobody uses it. Nothing under /api passes through here.
 */

/**
 * @typedef {{path: string, sha256: string}} Listed a file of the page, as the server lists it
 * @typedef {{cache: Cache, sha256: string}} Older the same in an older version
 */

const worker = /** @type {ServiceWorkerScope} */ (/** @type {unknown} */ (self));
const PREFIX = "elfslam-pages-";
const LIST = "/precache.json";
const PAGE = "/";
const ALSO_PAGE = "/phone.html";
const DESK = "/desk";
const NOT_OURS = ["/api", DESK, "/trust", "/authority.pem", "/openapi.json", "/service_worker.js", LIST];
const AT_ONCE = 6;
/** Windows of the desk, as far as this worker saw them open: asking for a client could wait for what waits for us. */
/** @type {Set<string>} */
const deskClients = new Set();

worker.addEventListener("install", (event) => event.waitUntil(keepAll()));
worker.addEventListener("activate", (event) => event.waitUntil(begin()));
worker.addEventListener("message", (event) => {
  if (event.data === "begin") event.waitUntil(beginUnlessOthersWalk());
});
worker.addEventListener("fetch", (event) => {
  const { method, url } = event.request;
  const { origin, pathname } = new URL(url);
  if (pathname.startsWith(DESK)) deskClients.add(event.resultingClientId);
  if (method !== "GET" || origin !== worker.location.origin || deskClients.has(event.clientId)) return;
  if (NOT_OURS.some((start) => pathname.startsWith(start))) return;
  event.respondWith(answer(event.request, pathname === ALSO_PAGE ? PAGE : pathname));
});

/** What is kept; what is not comes from the server. @param {Request} request @param {string} path */
async function answer(request, path) {
  const kept = await (await caches.open(PREFIX + VERSION)).match(path);
  return kept ?? fetch(request);
}

/** Fetch the page as the server lists it, or as an older version had it; all of it, or nothing. */
async function keepAll() {
  const listed = await fetch(LIST, { cache: "no-store" });
  /** @type {{version: string, files: Listed[]}} */
  const list = await listed.clone().json();
  if (list.version !== VERSION) throw new Error("the page changed while it was fetched");
  const older = await olderFiles();
  const cache = await caches.open(PREFIX + VERSION);
  const waiting = [...list.files];
  const work = async () => {
    for (let file = waiting.shift(); file !== undefined; file = waiting.shift()) {
      await cache.put(file.path, (await kept(older.get(file.path), file)) ?? (await fetched(file)));
    }
  };
  try {
    await Promise.all(Array.from({ length: AT_ONCE }, work));
    await cache.put(LIST, listed);
  } catch (error) {
    await caches.delete(PREFIX + VERSION);
    throw error;
  }
}

/** The files of the versions before this one: digest and cache by path. */
async function olderFiles() {
  /** @type {Map<string, Older>} */
  const found = new Map();
  for (const name of await olderCaches()) {
    const cache = await caches.open(name);
    const listed = await cache.match(LIST);
    /** @type {Listed[]} */
    const files = listed ? (await listed.json()).files : [];
    for (const { path, sha256 } of files) found.set(path, { cache, sha256 });
  }
  return found;
}

/** @param {Older | undefined} older @param {Listed} file */
async function kept(older, { path, sha256 }) {
  return older?.sha256 === sha256 ? older.cache.match(path) : undefined;
}

/** @param {Listed} file */
async function fetched({ path, sha256 }) {
  const response = await fetch(path, { cache: "no-cache" });
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", await response.clone().arrayBuffer()));
  const told = Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
  if (told !== sha256) throw new Error(`${path}: is not what the server listed`);
  return response;
}

async function begin() {
  const older = await olderCaches();
  for (const name of older) await caches.delete(name);
  await worker.clients.claim();
  if (older.length > 0) (await pages()).forEach((page) => page.postMessage("changed"));
}

/** The windows that show the phone page. */
async function pages() {
  const windows = await worker.clients.matchAll({ type: "window", includeUncontrolled: true });
  return windows.filter(({ url }) => !new URL(url).pathname.startsWith(DESK));
}

async function olderCaches() {
  return (await caches.keys()).filter((name) => name.startsWith(PREFIX) && name !== PREFIX + VERSION);
}

/** The page asks for it when nothing goes on there; another window may be on a walk. */
async function beginUnlessOthersWalk() {
  if ((await pages()).length <= 1) worker.skipWaiting();
}

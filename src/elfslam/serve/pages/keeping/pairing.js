/** Whom this phone belongs to, and the key that it trusts: kept when the server's code is scanned. */

import { openStore } from "./store.js";

const PAIRING = "pairing";
/** Nobody: a link opened a map here, and no account was ever paired. */
const GUEST = "";
const KEY = /^[A-Za-z0-9_-]{43}$/;

/** @typedef {{user: string, key: string | null}} Pairing */

/** @param {import("./store.js").Store} store @returns {Promise<string | null>} the digest of the key */
export async function pinnedKey(store) {
  return (await store.read(PAIRING))?.key ?? null;
}

/**
 * Trust the key that an address names; what somebody else kept here is forgotten, what a guest kept stays.
 * @param {import("./store.js").Store} store @param {string} fragment @param {string} user their id
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
 * @param {import("./store.js").Store} store @param {string} fragment
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

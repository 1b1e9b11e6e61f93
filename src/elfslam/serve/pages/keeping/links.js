/** Maps that this phone may use by a link: remembered, so that they are listed again without an account. */

const LINK = "link/";

/** @typedef {{map: string, name: string, venue: string | null, floor: string | null, created_utc: string,
 *   owner: string}} LinkedMap */

/** @param {import("./store.js").Store} store @param {LinkedMap} linked */
export async function rememberLink(store, linked) {
  await store.write(LINK + linked.map, linked);
}

/** @param {import("./store.js").Store} store @param {string} mapId */
export async function forgetLink(store, mapId) {
  await store.remove([LINK + mapId]);
}

/** @param {import("./store.js").Store} store @returns {Promise<LinkedMap[]>} */
export async function linkedMaps(store) {
  const names = (await store.names()).filter((name) => name.startsWith(LINK));
  const found = await Promise.all(names.map((name) => store.read(name)));
  return found.filter((each) => each !== undefined);
}

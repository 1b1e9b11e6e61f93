/** A map that somebody shared by link: opened here, and remembered, so that a phone without an account is located in it. */

import { forgetLink, linkedMaps, openStore, rememberLink, trustAsGuest } from "../keeping/store.js";
import { Problem, ask, linkIn, openLink } from "../shared/api.js";

/** @typedef {import("../keeping/store.js").LinkedMap} LinkedMap */

/**
 * Open the link of the address, where there is one. Raises Problem where it was withdrawn.
 * @param {Location} location @param {History} history @returns {Promise<boolean>} whether there was one
 */
export async function openShared(location, history) {
  const fragment = location.hash;
  const link = linkIn(fragment);
  if (link === null) return false;
  try {
    const { map } = await openLink(link);
    const store = await openStore();
    await trustAsGuest(store, fragment);
    await rememberLink(store, await linked(map));
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 0) forgetAddress(location, history);
    throw error;
  }
  forgetAddress(location, history);
  return true;
}

/** @param {Location} location @param {History} history */
function forgetAddress(location, history) {
  history.replaceState(null, "", location.pathname + location.search);
}

/** What the server says of a map that a link opened. @param {string} map its id @returns {Promise<LinkedMap>} */
async function linked(map) {
  const { name, venue, floor, created_utc, owner } = await ask("GET", `/api/maps/${encodeURIComponent(map)}`);
  return { map, name, venue, floor, created_utc, owner };
}

/** Whether links opened maps here before. @returns {Promise<boolean>} */
export async function hasLinks() {
  return globalThis.indexedDB !== undefined && (await linkedMaps(await openStore())).length > 0;
}

/**
 * The maps that links open, as they are now; a link that was withdrawn is forgotten.
 * @returns {Promise<LinkedMap[]>}
 */
export async function openLinks() {
  const store = await openStore();
  const now = await Promise.all((await linkedMaps(store)).map(async (each) => {
    try {
      return await linked(each.map);
    } catch (error) {
      if (/** @type {Problem} */ (error).status === 404) {
        await forgetLink(store, each.map);
        return null;
      }
      return each;
    }
  }));
  return now.filter((each) => each !== null);
}

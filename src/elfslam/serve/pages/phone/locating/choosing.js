/** Choosing a map: the list of those on this phone and on the server, got, updated and removed. */

import { openPackages } from "../../keeping/packages.js";
import { openStore } from "../../keeping/store.js";
import { ask } from "../../shared/api.js";
import { at, showView } from "../view.js";
import { offersOf, rowsOf } from "./maps.js";
import { floorsNear } from "./near.js";
import { askRemove, showMaps, showMapsTrouble, showOffline, showProgress } from "./place_view.js";

const NO_SERVER = "The server does not answer. The maps on this phone work without it.";

/**
 * @typedef {import("../../keeping/packages.js").Packages} Packages
 * @typedef {import("./maps.js").MapRow} MapRow
 * @typedef {import("./maps.js").OfferedMap} OfferedMap
 */

/**
 * @param {{act: (work: () => Promise<void>) => (event?: Event) => Promise<void>,
 *   chosen: (row: MapRow, packages: Packages) => Promise<void>,
 *   paired: () => Promise<void>}} given paired: when the server knows this phone, or does not answer
 * @returns {{list: () => Promise<void>}}
 */
export function makeChoosing({ act, chosen, paired }) {
  /** @type {Packages | null} */
  let opened = null;
  /** @type {import("./near.js").NearMap[]} */
  let near = [];

  async function list() {
    showView("maps");
    showOffline();
    const packages = (opened ??= openPackages(await openStore()));
    const does = deedsOn(packages);
    const kept = await packages.list();
    showMaps(rowsOf(kept, null), does);
    await paired();
    const offered = await offeredMaps(kept, near).catch((error) => {
      showMapsTrouble(kept.length > 0 && error.status === 0 ? NO_SERVER : error.message);
      return null;
    });
    if (offered) showMapsTrouble(null);
    showMaps(rowsOf(kept, offered), does);
  }

  /** @param {MapRow} row @param {Packages} packages */
  async function get({ id }, packages) {
    try {
      await packages.update(id, (progress) => showProgress(id, progress));
    } finally {
      showProgress(id, null);
    }
    await list();
  }

  async function lookAround() {
    at("maps-near").disabled = true;
    try {
      near = await floorsNear(navigator.geolocation);
      await list();
    } catch (error) {
      showMapsTrouble(/** @type {Error} */ (error).message);
    } finally {
      at("maps-near").disabled = false;
    }
  }

  /** @param {MapRow} row @param {Packages} packages */
  async function remove({ id }, packages) {
    if (!(await askRemove())) return;
    await packages.remove(id);
    await list();
  }

  /** @param {Packages} packages @returns {import("./place_view.js").Deeds} */
  const deedsOn = (packages) => ({
    open: (row, event) => act(() => chosen(row, packages))(event),
    get: (row, event) => act(() => get(row, packages))(event),
    remove: (row, event) => act(() => remove(row, packages))(event),
  });
  at("maps-near").addEventListener("click", act(lookAround));
  return { list };
}

/**
 * The server's maps, those near here, and the revision of those that this phone has.
 * @param {import("./maps.js").KeptMap[]} kept @param {import("./near.js").NearMap[]} near
 */
async function offeredMaps(kept, near) {
  const offers = offersOf(await ask("GET", "/api/maps"), near, kept);
  const held = new Set(kept.map(({ map }) => map));
  /** @param {OfferedMap} offer @returns {Promise<OfferedMap>} */
  const withRevision = async (offer) =>
    held.has(offer.id) ? { ...offer, revision: await revisionOf(offer.id) } : offer;
  return (await Promise.all(offers.map(withRevision))).filter(({ revision }) => revision !== null);
}

/** Null where the server has no such map any more. @param {string} id @returns {Promise<number | null>} */
async function revisionOf(id) {
  try {
    const { manifest } = await ask("GET", `/api/maps/${encodeURIComponent(id)}/package`);
    return JSON.parse(manifest).revision;
  } catch (error) {
    if (/** @type {import("../../shared/api.js").Problem} */ (error).status === 404) return null;
    throw error;
  }
}

/** Choosing a map: the list of those on this phone and on the server, got, updated and removed. */

import { openPackages } from "../../keeping/packages.js";
import { openStore } from "../../keeping/store.js";
import { ask } from "../../shared/api.js";
import { openLinks } from "../guest.js";
import { at, showView } from "../view.js";
import { offersOf, rowsOf, venuesOf } from "./maps.js";
import { floorsNear } from "./near.js";
import { askRemove, isGetting, showMaps, showMapsTrouble, showOffline, showProgress } from "./place_view.js";
import { t } from "../../shared/words.js";

const AGAIN_MS = 20_000;
const NO_SERVER = t("The server does not answer. The maps on this phone work without it.");

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
  let shown = "";
  /** Why nothing near was found; stands until the list is asked for anew. @type {string | null} */
  let aroundTrouble = null;

  async function list() {
    showView("maps");
    showOffline();
    shown = "";
    aroundTrouble = null;
    await fill();
  }

  /**
   * Only where something is another than before: who is about to tap keeps the button.
   * @param {MapRow[]} rows @param {import("./place_view.js").Deeds} does
   */
  function show(rows, does) {
    const now = JSON.stringify(rows);
    if (now === shown) return;
    shown = now;
    showMaps(venuesOf(rows), does);
  }

  async function fill() {
    const packages = (opened ??= openPackages(await openStore()));
    const does = deedsOn(packages);
    const kept = await packages.list();
    if (shown === "") show(rowsOf(kept, null), does);
    await paired();
    const offered = await offeredMaps(kept, near).catch((error) => {
      showMapsTrouble(kept.length > 0 && error.status === 0 ? NO_SERVER : error.message);
      return null;
    });
    if (offered) showMapsTrouble(aroundTrouble);
    show(rowsOf(kept, offered), does);
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
    } catch (error) {
      aroundTrouble = /** @type {Error} */ (error).message;
      showMapsTrouble(aroundTrouble);
      return;
    } finally {
      at("maps-near").disabled = false;
    }
    await list();
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
  // What was deleted, renamed or shared elsewhere shows without a reload.
  setInterval(() => {
    if (!at("maps").hidden && !document.hidden && !isGetting()) fill().catch(() => {});
  }, AGAIN_MS);
  return { list };
}

/**
 * The server's maps, those that links open, those near here, and the revision of those that this phone has.
 * @param {import("./maps.js").KeptMap[]} kept @param {import("./near.js").NearMap[]} near
 */
async function offeredMaps(kept, near) {
  const linked = await openLinks();
  const offers = offersOf(await ownMaps(linked.length > 0), near, kept, linked);
  const held = new Set(kept.map(({ map }) => map));
  /** @param {OfferedMap} offer @returns {Promise<OfferedMap>} */
  const withRevision = async (offer) =>
    held.has(offer.id) ? { ...offer, revision: await revisionOf(offer.id) } : offer;
  return (await Promise.all(offers.map(withRevision))).filter(({ revision }) => revision !== null);
}

/** Nothing for who has a link and no account. @param {boolean} hasLinks @returns {Promise<OfferedMap[]>} */
async function ownMaps(hasLinks) {
  try {
    return await ask("GET", "/api/maps");
  } catch (error) {
    const isGuest = hasLinks && /** @type {import("../../shared/api.js").Problem} */ (error).status === 401;
    if (!isGuest) throw error;
    at("maps-near").parentElement.hidden = true; // the server tells its users alone what lies near
    return [];
  }
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

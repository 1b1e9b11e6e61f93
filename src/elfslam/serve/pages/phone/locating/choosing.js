/** Choosing a map: the list of those on this phone and on the server, got, updated and removed. */

import { openPackages } from "../../keeping/packages.js";
import { openStore } from "../../keeping/store.js";
import { Problem, ask } from "../../shared/api.js";
import { inSentence, t } from "../../shared/words.js";
import { openLinks } from "../guest.js";
import { at, showView } from "../view.js";
import { askRemove, isGetting, showMaps, showMapsTrouble, showOffline, showProgress } from "./place_view.js";
import { floorName } from "./words.js";

const AGAIN_MS = 20_000;
const NO_SERVER = t("The server does not answer. The maps on this phone work without it.");

/**
 * @typedef {import("../../keeping/packages.js").Packages} Packages
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
  /** @type {NearMap[]} */
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

  /** With the other floors of its building, for ways lead over them. @param {MapRow} row @param {Packages} packages */
  async function get({ id }, packages) {
    const show = (/** @type {import("../../keeping/packages.js").Progress} */ progress) => showProgress(id, progress);
    try {
      await packages.update(id, show);
      const floors = (await packages.list()).find(({ map }) => map === id)?.floors ?? [];
      for (const { map } of floors) await packages.update(map, show).catch(passOverMissing);
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
 * @param {KeptMap[]} kept @param {NearMap[]} near
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

/** A floor may be shared with somebody and another not. @param {Problem} error */
function passOverMissing(error) {
  if (error.status !== 404) throw error;
}

// The maps to choose from: those on this phone, and those of the server, by venue and floor. Pure.

/**
 * @typedef {{id: string, name: string, isHere: boolean, isOld: boolean, canGet: boolean,
 *   sizeBytes: number | null, when: string | null, venue: string | null, floor: string | null,
 *   owner: string | null}} MapRow isOld: the server has a newer one; when: made, ISO; owner: who shared it
 * @typedef {{map: string, name: string, revision: number, madeUtc: string, sizeBytes: number,
 *   venue?: string | null, floor?: string | null}} KeptMap
 * @typedef {{id: string, name: string, created_utc?: string, revision?: number | null, venue?: string | null,
 *   floor?: string | null, owner?: string | null, right?: string}} OfferedMap revision: null where the server has it
 *   no more
 * @typedef {import("../../keeping/store.js").LinkedMap} LinkedMap
 */

/**
 * What the server may have for this phone: its user's maps and those shared with them, maps that links open,
 * published floors, and of those that are kept here whatever it published.
 * @param {OfferedMap[]} mine @param {OfferedMap[]} near @param {KeptMap[]} kept @param {LinkedMap[]} [linked]
 * @returns {OfferedMap[]}
 */
export function offersOf(mine, near, kept, linked = []) {
  const others = kept.map(({ map: id, name, venue, floor }) => ({ id, name, venue, floor }));
  const byLink = linked.map(({ map: id, ...told }) => ({ id, ...told }));
  const byId = new Map([...others, ...near, ...byLink, ...mine].map((offer) => [offer.id, offer]));
  return [...byId.values()];
}

/**
 * Those on this phone first, by name; then floors near here, the likeliest first; then the server's, the newest first.
 * @param {KeptMap[]} kept
 * @param {OfferedMap[] | null} offered null where the server does not answer
 * @returns {MapRow[]}
 */
export function rowsOf(kept, offered) {
  const held = new Set(kept.map(({ map }) => map));
  const here = kept.map((one) => keptRow(one, offered?.find(({ id }) => id === one.map)));
  const there = (offered ?? []).filter(({ id }) => !held.has(id)).map(offeredRow);
  const dated = /** @type {(MapRow & {when: string})[]} */ (there.filter(({ when }) => when !== null));
  return [
    ...here.sort((a, b) => a.name.localeCompare(b.name)),
    ...there.filter(({ when }) => when === null),
    ...dated.sort((a, b) => b.when.localeCompare(a.when)),
  ];
}

/**
 * Rows by venue, each venue where its first row was; those of no venue come last.
 * @param {MapRow[]} rows @returns {{venue: string | null, rows: MapRow[]}[]}
 */
export function venuesOf(rows) {
  /** @type {Map<string | null, MapRow[]>} */
  const groups = new Map();
  for (const row of rows) groups.set(row.venue, [...(groups.get(row.venue) ?? []), row]);
  const told = [...groups].map(([venue, inside]) => ({ venue, rows: inside }));
  return [...told.filter(({ venue }) => venue !== null), ...told.filter(({ venue }) => venue === null)];
}

/** @param {KeptMap} kept @param {OfferedMap | undefined} offer @returns {MapRow} */
function keptRow({ map, name, revision, madeUtc, sizeBytes, venue, floor }, offer) {
  const isOld = (offer?.revision ?? revision) > revision;
  return {
    id: map, name, isHere: true, isOld, canGet: offer !== undefined, sizeBytes, when: madeUtc,
    venue: offer?.venue ?? venue ?? null, floor: offer?.floor ?? floor ?? null, owner: ownerOf(offer),
  };
}

/** @param {OfferedMap} offer @returns {MapRow} */
function offeredRow(offer) {
  const { id, name, created_utc, venue, floor } = offer;
  return {
    id, name, isHere: false, isOld: false, canGet: true, sizeBytes: null, when: created_utc ?? null,
    venue: venue ?? null, floor: floor ?? null, owner: ownerOf(offer),
  };
}

/** Who shared it; null for one's own. @param {OfferedMap | undefined} offer */
function ownerOf(offer) {
  return offer === undefined || offer.right === "own" ? null : offer.owner ?? null;
}

// The floors around the phone: the server is asked once, by where the phone believes itself to be.

const PATIENCE = { enableHighAccuracy: true, timeout: 20_000, maximumAge: 60_000 };
/** Browsers tell the radius that holds 95 % of a plane's Gaussian: so many sigmas. */
const SIGMAS = Math.sqrt(-2 * Math.log(0.05));
const [LEAST_M, MOST_M] = [1, 2000];
const NOT_ALLOWED = 1;

export const NO_POSITION = t("This browser tells no page where the phone is. Choose the place from the list.");
export const REFUSED =
  t("The page may not know where the phone is: allow it in the browser's settings, or choose from the list.");
export const LOST = t("The phone does not know where it is. Go near a window and try again, or choose from the list.");
export const NOTHING_NEAR =
  t("No map of a place near here is published. Choose from the list, or walk through the place to map it.");

/** @typedef {{id: string, name: string, revision: number, venue: string, floor: string}} NearMap */

/**
 * The published floors around the phone, the likeliest first.
 * @param {Geolocation | undefined} geolocation @returns {Promise<NearMap[]>} Raises Problem.
 */
export async function floorsNear(geolocation) {
  const position = await positionBy(geolocation);
  const floors = floorsOf(await ask("POST", "/api/find", questionOf(position)));
  if (floors.length === 0) throw new Problem(NOTHING_NEAR, 0);
  return floors;
}

/**
 * What the server is asked. The altitude stays here: browsers count it from another zero than maps do.
 * @param {{coords: {latitude: number, longitude: number, accuracy: number}}} position
 */
export function questionOf({ coords: { latitude, longitude, accuracy } }) {
  const sigma = Math.min(Math.max(accuracy / SIGMAS, LEAST_M), MOST_M);
  return { position: { latitude_deg: latitude, longitude_deg: longitude, sigma_m: sigma } };
}

/**
 * @param {{candidates: {building: string, floor: number, map: string, revision: number}[]}} answer
 * @returns {NearMap[]}
 */
function floorsOf({ candidates }) {
  return candidates.map(({ building, floor, map, revision }) => {
    const name = floorName(floor);
    return { id: map, name: `${building}, ${inSentence(name)}`, revision, venue: building, floor: name };
  });
}

/** @param {Geolocation | undefined} geolocation @returns {Promise<GeolocationPosition>} */
function positionBy(geolocation) {
  if (!geolocation) throw new Problem(NO_POSITION, 0);
  return new Promise((resolve, reject) => {
    /** @param {GeolocationPositionError} error */
    const failed = ({ code }) => reject(new Problem(code === NOT_ALLOWED ? REFUSED : LOST, 0));
    geolocation.getCurrentPosition(resolve, failed, PATIENCE);
  });
}

/** Choosing a map: the list of those on this phone and on the server, got, updated and removed. */

import { openPackages } from "../../keeping/packages.js";
import { openStore } from "../../keeping/store.js";
import { ask } from "../../shared/api.js";
import { showView } from "../view.js";
import { rowsOf } from "./maps.js";
import { askRemove, showMaps, showMapsTrouble, showOffline, showProgress } from "./place_view.js";

const NO_SERVER = "The server does not answer. The maps on this phone work without it.";

/**
 * @param {{act: (work: () => Promise<void>) => (event?: Event) => Promise<void>,
 *   chosen: (row: import("./maps.js").MapRow, packages: import("../../keeping/packages.js").Packages) => Promise<void>,
 *   paired: () => Promise<void>}} given paired: when the server knows this phone, or does not answer
 * @returns {{list: () => Promise<void>}}
 */
export function makeChoosing({ act, chosen, paired }) {
  /** @type {import("../../keeping/packages.js").Packages | null} */
  let packages = null;

  async function list() {
    showView("maps");
    showOffline();
    packages ??= openPackages(await openStore());
    const kept = await packages.list();
    showMaps(rowsOf(kept, null), does);
    await paired();
    const offered = await offeredMaps(kept).catch((error) => {
      showMapsTrouble(kept.length > 0 && error.status === 0 ? NO_SERVER : error.message);
      return null;
    });
    if (offered) showMapsTrouble(null);
    showMaps(rowsOf(kept, offered), does);
  }

  async function get({ id }) {
    try {
      await packages.update(id, (progress) => showProgress(id, progress));
    } finally {
      showProgress(id, null);
    }
    await list();
  }

  async function remove({ id }) {
    if (!(await askRemove())) return;
    await packages.remove(id);
    await list();
  }

  const does = {
    open: (row, event) => act(() => chosen(row, packages))(event),
    get: (row, event) => act(() => get(row))(event),
    remove: (row, event) => act(() => remove(row))(event),
  };
  return { list };
}

/** The server's maps, and the revision of those that this phone has. @param {import("./maps.js").KeptMap[]} kept */
async function offeredMaps(kept) {
  const offered = await ask("GET", "/api/maps");
  const held = new Set(kept.map(({ map }) => map));
  const withRevision = async (offer) => (held.has(offer.id) ? { ...offer, revision: await revisionOf(offer.id) } : offer);
  return Promise.all(offered.map(withRevision));
}

async function revisionOf(id) {
  const { manifest } = await ask("GET", `/api/maps/${encodeURIComponent(id)}/package`);
  return JSON.parse(manifest).revision;
}

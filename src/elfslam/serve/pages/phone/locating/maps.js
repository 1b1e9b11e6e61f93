/** The maps to choose from: those on this phone, and those of the server, by venue and floor. Pure. */

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

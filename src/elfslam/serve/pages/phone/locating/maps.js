/** The maps to choose from: those on this phone, and those of the server. Pure. */

/**
 * @typedef {{id: string, name: string, isHere: boolean, isOld: boolean, canGet: boolean,
 *   sizeBytes: number | null, when: string | null}} MapRow isOld: the server has a newer one; when: made, ISO
 * @typedef {{map: string, name: string, revision: number, madeUtc: string, sizeBytes: number}} KeptMap
 * @typedef {{id: string, name: string, created_utc?: string, revision?: number | null}} OfferedMap revision: null
 *   where the server has it no more
 */

/**
 * What the server may have for this phone: its user's maps, published floors, and of those that are kept here
 * whatever it published.
 * @param {OfferedMap[]} mine @param {OfferedMap[]} near @param {KeptMap[]} kept @returns {OfferedMap[]}
 */
export function offersOf(mine, near, kept) {
  const others = kept.map(({ map: id, name }) => ({ id, name }));
  const byId = new Map([...others, ...near, ...mine].map((offer) => [offer.id, offer]));
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

/** @param {KeptMap} kept @param {OfferedMap | undefined} offer @returns {MapRow} */
function keptRow({ map, name, revision, madeUtc, sizeBytes }, offer) {
  const isOld = (offer?.revision ?? revision) > revision;
  return { id: map, name, isHere: true, isOld, canGet: offer !== undefined, sizeBytes, when: madeUtc };
}

/** @param {OfferedMap} offer @returns {MapRow} */
function offeredRow({ id, name, created_utc }) {
  return { id, name, isHere: false, isOld: false, canGet: true, sizeBytes: null, when: created_utc ?? null };
}

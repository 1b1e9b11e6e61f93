/** What has to be cut off a walk that ended without being stopped, so that its files agree again. */

/** When each chirp was played. */
export const CHIRPS = "chirps.csv";
/** When the walker was at a place that they gave a name. */
export const CHECKPOINTS = "checkpoints.csv";
const TABLES = ["accelerometer.csv", "gyroscope.csv", CHIRPS, CHECKPOINTS];
export const SOUND_FILES = {
  baseband: { table: "baseband.csv", file: "baseband.iq", headerBytes: 0 },
  whole: { table: "frames.csv", file: "frames.wav", headerBytes: 44 },
};
export const TABLE_FILES = TABLES;

/**
 * Sizes to cut files down to; only those that are too long are named.
 * @param {{table: string, frameBytes: number, headerBytes: number, fileBytes: number}} sound the text of
 *   the table of frames, and how long the file of frames is
 * @param {Record<string, string>} tables text of the other tables
 * @returns {{sound: {table?: number, file?: number}, tables: Record<string, number>}}
 */
export function cutsFor(sound, tables) {
  const rows = wholeRows(sound.table);
  const frames = Math.max(Math.floor((sound.fileBytes - sound.headerBytes) / sound.frameBytes), 0);
  const count = Math.min(rows.length - 1, frames);
  const tableBytes = rows.slice(0, count + 1).join("").length;
  const fileBytes = sound.headerBytes + count * sound.frameBytes;
  /** @type {ReturnType<typeof cutsFor>} */
  const cuts = { sound: {}, tables: {} };
  if (tableBytes < sound.table.length) cuts.sound.table = tableBytes;
  if (fileBytes < sound.fileBytes) cuts.sound.file = fileBytes;
  for (const [name, text] of Object.entries(tables)) {
    const whole = wholeRows(text).join("").length;
    if (whole < text.length) cuts.tables[name] = whole;
  }
  return cuts;
}

/** Lines that end, with their ends. @param {string} text @returns {string[]} */
function wholeRows(text) {
  return text.match(/[^\n]*\n/g) ?? [];
}

/** @param {string} table @returns {number} time of the last row, 0 where there is none */
export function lastTime(table) {
  const rows = wholeRows(table);
  return rows.length > 1 ? Number.parseFloat(rows[rows.length - 1]) : 0;
}

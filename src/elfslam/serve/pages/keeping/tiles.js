/**
 * The parts of a map, read back into one. All is little-endian. A tile: the number of spots n, their walks (n) and
 * their order along them (n) as uint32; float32 blocks of places (2n), headings (n), covariances (3n: xx, xy, yy)
 * and weights (n). A stretch of features: n and the order of its spots (n) as uint32; float16 features (128n).
 */

import { ELF_SIZE } from "../stages/constants.js";
import { t } from "../shared/words.js";

const HEAD_BYTES = 4;
/** @type {["walk" | "order", number][]} what a tile holds, in its order, and how many of a spot */
const WHOLE = [["walk", 1], ["order", 1]];
/** @type {["xyM" | "headingRad" | "covarianceM2" | "weight", number][]} */
const NUMBERS = [["xyM", 2], ["headingRad", 1], ["covarianceM2", 3], ["weight", 1]];
const TILE_SPOT_BYTES = 4 * 9;
const STRETCH_SPOT_BYTES = 4 + 2 * ELF_SIZE;
const WALK = 2 ** 32;
const CUT_OFF = t("A part of the map is cut off.");
const NO_FEATURES = t("Spots of the map have no features.");

/**
 * @typedef {{
 *   xyM: Float32Array, headingRad: Float32Array, covarianceM2: Float32Array, weight: Float32Array,
 *   walk: Uint32Array, order: Uint32Array, vectors: Float32Array,
 * }} Spots
 * @typedef {{walk: number, bytes: Uint8Array<ArrayBuffer>}} Stretch
 */

/**
 * The spots of all tiles, tile after tile. Raises RangeError for a part that is cut off or missing.
 * @param {Uint8Array<ArrayBuffer>[]} tiles @param {Stretch[]} stretches @returns {Spots}
 */
export function spotsOf(tiles, stretches) {
  const numbers = numbersOf(tiles);
  const spots = { ...numbers, vectors: new Float32Array(ELF_SIZE * numbers.headingRad.length) };
  fillFeatures(spots, stretches);
  return spots;
}

/** The same without features. @param {Uint8Array<ArrayBuffer>[]} tiles @returns {Omit<Spots, "vectors">} */
export function numbersOf(tiles) {
  const counts = tiles.map((tile) => countOf(tile, TILE_SPOT_BYTES));
  const total = counts.reduce((sum, count) => sum + count, 0);
  const spots = /** @type {Omit<Spots, "vectors">} */ ({});
  for (const [name, width] of WHOLE) spots[name] = new Uint32Array(width * total);
  for (const [name, width] of NUMBERS) spots[name] = new Float32Array(width * total);
  let first = 0;
  tiles.forEach((tile, k) => {
    fill(spots, first, aligned(tile), counts[k]);
    first += counts[k];
  });
  return spots;
}

/** @param {Omit<Spots, "vectors">} spots @param {number} first @param {Uint8Array<ArrayBuffer>} tile @param {number} count */
function fill(spots, first, tile, count) {
  let at = tile.byteOffset + HEAD_BYTES;
  for (const [name, width] of [...WHOLE, ...NUMBERS]) {
    const Numbers = spots[name] instanceof Uint32Array ? Uint32Array : Float32Array;
    spots[name].set(new Numbers(tile.buffer, at, width * count), width * first);
    at += 4 * width * count;
  }
}

/** @param {Spots} spots @param {Stretch[]} stretches */
function fillFeatures({ walk, order, vectors }, stretches) {
  const whole = (wholes ??= Float32Array.from({ length: 2 ** 16 }, (_, half) => wholeOf(half)));
  const rows = new Map(Array.from(order, (each, row) => [walk[row] * WALK + each, row]));
  let filled = 0;
  for (const { walk: of, bytes } of stretches) {
    const count = countOf(bytes, STRETCH_SPOT_BYTES);
    const { buffer, byteOffset } = aligned(bytes);
    const orders = new Uint32Array(buffer, byteOffset + HEAD_BYTES, count);
    const halves = new Uint16Array(buffer, byteOffset + HEAD_BYTES + 4 * count, ELF_SIZE * count);
    for (let k = 0; k < count; k += 1) {
      const row = rows.get(of * WALK + orders[k]);
      if (row === undefined) continue;
      for (let j = 0; j < ELF_SIZE; j += 1) vectors[ELF_SIZE * row + j] = whole[halves[ELF_SIZE * k + j]];
      filled += 1;
    }
  }
  if (filled !== order.length) throw new RangeError(NO_FEATURES);
}

/** @param {Uint8Array} bytes @param {number} spotBytes */
function countOf(bytes, spotBytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const count = bytes.length < HEAD_BYTES ? NaN : view.getUint32(0, true);
  if (bytes.length !== HEAD_BYTES + spotBytes * count) throw new RangeError(CUT_OFF);
  return count;
}

/** The same bytes where numbers may begin. @param {Uint8Array<ArrayBuffer>} bytes */
function aligned(bytes) {
  return bytes.byteOffset % 4 === 0 ? bytes : bytes.slice();
}

/** All of them: looking one up takes a tenth of working it out. @type {Float32Array | null} */
let wholes = null;

/** A half-precision number: browsers without Float16Array are many. @param {number} half its bits */
export function wholeOf(half) {
  const sign = half & 0x8000 ? -1 : 1;
  const exponent = (half >> 10) & 31;
  const fraction = half & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1024 + fraction) * 2 ** (exponent - 25);
}

/**
 * Tiles of a map, read back into one map. A tile is little-endian: the number of spots n (uint32), float32
 * blocks of places (2n), headings (n), covariances (3n: xx, xy, yy) and weights (n), float16 features (128n).
 */

const COUNT_BYTES = 4;
const BLOCKS = { xyM: 2, headingRad: 1, covarianceM2: 3, weight: 1 };
const NUMBERS = 7;
const FEATURES = 128;
const SPOT_BYTES = 4 * NUMBERS + 2 * FEATURES;

/**
 * @typedef {{
 *   xyM: Float32Array, headingRad: Float32Array, covarianceM2: Float32Array, weight: Float32Array,
 *   vectors: Float32Array,
 * }} Spots
 */

/**
 * The spots of all tiles, tile after tile. Raises RangeError for a tile that is cut off.
 * @param {Uint8Array[]} tiles @returns {Spots}
 */
export function spotsOf(tiles) {
  const counts = tiles.map(countOf);
  const total = counts.reduce((sum, count) => sum + count, 0);
  const spots = { vectors: new Float32Array(FEATURES * total) };
  for (const [name, width] of Object.entries(BLOCKS)) spots[name] = new Float32Array(width * total);
  let first = 0;
  tiles.forEach((tile, k) => {
    fill(spots, first, aligned(tile), counts[k]);
    first += counts[k];
  });
  return spots;
}

function countOf(tile) {
  const count = tile.length < COUNT_BYTES ? NaN : viewOf(tile).getUint32(0, true);
  if (tile.length !== COUNT_BYTES + SPOT_BYTES * count) throw new RangeError("A tile of the map is cut off.");
  return count;
}

function viewOf(bytes) {
  return new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
}

/** The same bytes where numbers may begin. */
function aligned(bytes) {
  return bytes.byteOffset % 4 === 0 ? bytes : bytes.slice();
}

function fill(spots, first, tile, count) {
  let at = tile.byteOffset + COUNT_BYTES;
  for (const [name, width] of Object.entries(BLOCKS)) {
    spots[name].set(new Float32Array(tile.buffer, at, width * count), width * first);
    at += 4 * width * count;
  }
  const halves = new Uint16Array(tile.buffer, at, FEATURES * count);
  const out = spots.vectors.subarray(FEATURES * first);
  for (let k = 0; k < halves.length; k += 1) out[k] = wholeOf(halves[k]);
}

/** A half-precision number: browsers without Float16Array are many. */
export function wholeOf(half) {
  const sign = half & 0x8000 ? -1 : 1;
  const exponent = (half >> 10) & 31;
  const fraction = half & 1023;
  if (exponent === 0) return sign * fraction * 2 ** -24;
  if (exponent === 31) return fraction ? NaN : sign * Infinity;
  return sign * (1024 + fraction) * 2 ** (exponent - 25);
}

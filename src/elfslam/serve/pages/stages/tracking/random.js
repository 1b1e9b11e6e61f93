/** Chance for a tracker that must give the same fixes for the same seed. */

/** @typedef {{uniform: () => number, normal: () => number}} Random */

/**
 * Sfc32 (Doty-Humphrey's small fast counting generator) for uniform draws in [0, 1), and Marsaglia's polar
 * method for normal ones.
 * @param {number} seed a whole number below 2^32
 * @returns {Random}
 */
export function makeRandom(seed) {
  const next = sfc32(seed >>> 0);
  const uniform = () => next() / 2 ** 32;
  let spare = NaN;
  const normal = () => {
    if (!Number.isNaN(spare)) {
      const kept = spare;
      spare = NaN;
      return kept;
    }
    const [x, y, square] = insideCircle(uniform);
    const scale = Math.sqrt((-2 * Math.log(square)) / square);
    spare = y * scale;
    return x * scale;
  };
  return { uniform, normal };
}

/** @param {() => number} uniform */
function insideCircle(uniform) {
  for (;;) {
    const [x, y] = [2 * uniform() - 1, 2 * uniform() - 1];
    const square = x * x + y * y;
    if (square > 0 && square < 1) return [x, y, square];
  }
}

/** @param {number} seed */
function sfc32(seed) {
  let [a, b, c, counter] = [seed, 0, 0, 1];
  const next = () => {
    const drawn = (a + b + counter) | 0;
    counter = (counter + 1) | 0;
    a = b ^ (b >>> 9);
    b = (c + (c << 3)) | 0;
    c = ((c << 21) | (c >>> 11)) + drawn | 0;
    return drawn >>> 0;
  };
  for (let k = 0; k < 12; k += 1) next();
  return next;
}

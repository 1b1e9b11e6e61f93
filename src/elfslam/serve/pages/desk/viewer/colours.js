// Colours for numbers and for walks. Pure. Scales rise evenly in lightness and are read the same
// by people with any kind of colour vision (viridis: S. van der Walt and N. Smith 2015; cividis:
// J. R. Nunez, C. R. Anderton and R. S. Renslow 2018), given here by nine stops each.

/** @typedef {[number, number, number]} Rgb 0 to 255 */

/** @type {Record<string, string[]>} */
const STOPS = {
  viridis: ["440154", "472d7b", "3b528b", "2c728e", "21918c", "28ae80", "5ec962", "addc30", "fde725"],
  cividis: ["00224e", "1a386f", "434e6c", "61656f", "7d7c78", "9b9476", "bcae6c", "dec958", "fee838"],
};

/** @param {string} hex six digits, with or without # @returns {Rgb} */
export function rgbOf(hex) {
  const number = Number.parseInt(hex.replace("#", ""), 16);
  return [number >> 16, (number >> 8) & 255, number & 255];
}

/** @param {"viridis" | "cividis"} scale @param {number} share 0 to 1 @returns {Rgb} */
export function colourAt(scale, share) {
  const stops = STOPS[scale];
  const at = Math.min(1, Math.max(0, share)) * (stops.length - 1);
  const low = Math.min(Math.floor(at), stops.length - 2);
  const [from, to] = [rgbOf(stops[low]), rgbOf(stops[low + 1])];
  return /** @type {Rgb} */ (from.map((value, k) => Math.round(value + (to[k] - value) * (at - low))));
}

/** @param {Rgb} rgb @param {number} [alpha] */
export function css([red, green, blue], alpha = 1) {
  return `rgb(${red} ${green} ${blue} / ${alpha})`;
}

/** Lines on a ground need contrast: time runs over the part of viridis that has it.
 * @param {number} share 0 to 1 @param {boolean} dark @returns {Rgb} */
export function timeColour(share, dark) {
  return colourAt("viridis", dark ? 0.36 + 0.64 * share : 0.66 * share);
}

/** Relative luminance (WCAG 2.2). @param {Rgb} rgb @returns {number} 0 to 1 */
export function luminance(rgb) {
  const [r, g, b] = rgb.map((value) => {
    const share = value / 255;
    return share <= 0.04045 ? share / 12.92 : ((share + 0.055) / 1.055) ** 2.4;
  });
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

/** Contrast ratio (WCAG 2.2). @param {Rgb} one @param {Rgb} other @returns {number} 1 to 21 */
export function contrast(one, other) {
  const [low, high] = [luminance(one), luminance(other)].sort((a, b) => a - b);
  return (high + 0.05) / (low + 0.05);
}

/**
 * Round limits for a scale over numbers that may hold nulls; null where there is no number.
 * @param {(number | null)[][]} rows @returns {{low: number, high: number} | null}
 */
export function limitsOf(rows) {
  const numbers = rows.flat().filter((value) => value !== null && Number.isFinite(value));
  if (numbers.length === 0) return null;
  const values = /** @type {number[]} */ (numbers);
  const [low, high] = [Math.min(...values), Math.max(...values)];
  return { low, high: high > low ? high : low + Math.max(Math.abs(low) * 0.1, 1e-3) };
}

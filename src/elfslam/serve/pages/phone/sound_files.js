/** Bytes of the files that hold sound. All numbers are little-endian. */

/** @param {Float32Array} samples in [-1, 1] @returns {Uint8Array} 16 bits each */
export function toPcm(samples) {
  const bytes = new Uint8Array(2 * samples.length);
  const view = new DataView(bytes.buffer);
  samples.forEach((value, k) => {
    const step = Math.round(Math.max(-1, Math.min(1, value)) * 32767);
    view.setInt16(2 * k, step, true);
  });
  return bytes;
}

/** @param {Int16Array} values @returns {Uint8Array} */
export function toBytes(values) {
  const bytes = new Uint8Array(2 * values.length);
  const view = new DataView(bytes.buffer);
  values.forEach((value, k) => view.setInt16(2 * k, value, true));
  return bytes;
}

/** The largest size that a WAV can claim: the file was streamed, and ends where it ends. */
const STREAMED = 0xffffffff;

/** @param {number} rateHz @returns {Uint8Array} header of a mono, 16-bit WAV of unknown length */
export function wavHeader(rateHz) {
  const bytes = new Uint8Array(44);
  const view = new DataView(bytes.buffer);
  /** @param {number} at @param {string} letters */
  const text = (at, letters) => bytes.set(new TextEncoder().encode(letters), at);
  text(0, "RIFF");
  view.setUint32(4, STREAMED, true);
  text(8, "WAVEfmt ");
  view.setUint32(16, 16, true);
  view.setUint16(20, 1, true);
  view.setUint16(22, 1, true);
  view.setUint32(24, rateHz, true);
  view.setUint32(28, 2 * rateHz, true);
  view.setUint16(32, 2, true);
  view.setUint16(34, 16, true);
  text(36, "data");
  view.setUint32(40, STREAMED, true);
  return bytes;
}

/**
 * A frame's row in its table.
 * @param {number} tS @param {number} [scale] what one step of its 16 bits stands for
 */
export function frameRow(tS, scale) {
  const columns = scale === undefined ? [] : [String(scale)];
  return `${[tS.toFixed(9), ...columns].join(",")}\n`;
}

/** First line of the table of frames, by what is kept. */
export const FRAME_HEADERS = { baseband: "t_s,scale\n", whole: "t_s\n" };

/** Bytes as text, and what they are known by. */

/** @param {string} text base64 or base64url, with or without padding @returns {Uint8Array<ArrayBuffer>} */
export function fromBase64(text) {
  const plain = text.replaceAll("-", "+").replaceAll("_", "/");
  return Uint8Array.from(atob(plain), (letter) => letter.charCodeAt(0));
}

/** @param {Uint8Array} bytes @returns {string} as addresses carry it: base64url without padding */
export function toBase64Url(bytes) {
  const plain = btoa(String.fromCharCode(...bytes));
  return plain.replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
}

/** @param {Uint8Array} bytes @returns {string} hexadecimal */
export function toHex(bytes) {
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/** @param {BufferSource} bytes @returns {Promise<Uint8Array<ArrayBuffer>>} */
export async function sha256(bytes) {
  return new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
}

/** @param {BufferSource} bytes @returns {Promise<string>} hexadecimal */
export async function sha256Hex(bytes) {
  return toHex(await sha256(bytes));
}

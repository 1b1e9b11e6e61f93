// Which page an address means. Pure.

import { linkIn } from "../shared/api.js";

/** @typedef {"recordings" | "jobs" | "maps" | "users" | "map" | "recording" | "shared" | "missing"} PageName */

const LISTS = ["recordings", "jobs", "maps", "users"];

/** @param {string} fragment such as #/maps/ID, or #link=… @returns {{name: PageName, id: string}} */
export function pageOf(fragment) {
  const link = linkIn(fragment);
  if (link !== null) return { name: "shared", id: link };
  const [name, id, ...more] = fragment.replace(/^#\/?/, "").split("/");
  if (name === "" && !id) return { name: "recordings", id: "" };
  if (name === "maps" && id && more.length === 0) return { name: "map", id: decoded(id) };
  if (name === "recordings" && id && more.length === 0) return { name: "recording", id: decoded(id) };
  if (LISTS.includes(name) && !id) return { name: /** @type {PageName} */ (name), id: "" };
  return { name: "missing", id: "" };
}

/** @param {string} text */
function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

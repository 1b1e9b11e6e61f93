// Which page an address means. Pure.

/** @typedef {"recordings" | "jobs" | "maps" | "users" | "map" | "recording"} PageName */

/** @param {string} fragment such as #/maps/ID @returns {{name: PageName, id: string}} */
export function pageOf(fragment) {
  const [name, id] = fragment.replace(/^#\/?/, "").split("/");
  if (name === "maps" && id) return { name: "map", id: decoded(id) };
  if (name === "recordings" && id) return { name: "recording", id: decoded(id) };
  if (name === "jobs" || name === "maps" || name === "users") return { name, id: "" };
  return { name: "recordings", id: "" };
}

/** @param {string} text */
function decoded(text) {
  try {
    return decodeURIComponent(text);
  } catch {
    return text;
  }
}

/** Links that open a map without an account: `#link=…&key=…` behind the address of a page. */

import { ask } from "./api.js";

/** @typedef {{map: string, name: string, may: "read" | "edit"}} OpenedLink */

/** @param {string} fragment @returns {string | null} what the link holds, where there is one */
export function linkIn(fragment) {
  return new URLSearchParams(fragment.replace(/^#/, "")).get("link");
}

/** Open a link: from now on this browser may look at its map. Raises Problem where it was withdrawn.
 * @param {string} link @returns {Promise<OpenedLink>} */
export function openLink(link) {
  return ask("POST", "/api/links/open", { link });
}

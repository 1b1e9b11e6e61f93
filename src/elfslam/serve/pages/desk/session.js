// Who is here: the token of the address becomes a cookie, and leaves the address.

import { Problem, openSession, request, requestJson } from "../shared/api.js";
import { forgetHere } from "../keeping/store.js";

/** @typedef {{id: string, name: string, is_owner: boolean, used_bytes: number, limits: any}} Me */

/**
 * Whoever the page belongs to; null without a session. Throws Problem for anything else.
 * @returns {Promise<Me | null>}
 */
export async function whoIsHere() {
  try {
    await openSession(location, history);
    return await requestJson("/api/me");
  } catch (problem) {
    if (problem instanceof Problem && problem.status === 401) return null;
    throw problem;
  }
}

/** Forget the maps that this browser keeps, and its session: the page leaves as soon as that is gone. */
export async function signOut() {
  await forgetHere();
  await request("/api/session", { method: "DELETE" });
}

/** What stands in the way of sending, in words, and when to try again. */

import { NOT_PAIRED } from "../shared/api.js";
import { t, translated } from "../shared/words.js";

const KEPT = t("Everything is kept on this phone, and sending goes on by itself.");
const LONGEST_S = 15;

/**
 * @typedef {{said: string, retryS: number | null, isGone: boolean}} Trouble retryS: null where trying
 *   again is of no use; isGone: the server has dropped the upload, so it begins anew
 */

/**
 * @param {number} status of the answer, 0 where none came
 * @param {string} detail what the server said
 * @param {number} attempt counted from 0 since something last went well
 * @param {number} [retryAfterS] what the server asked for
 * @returns {Trouble}
 */
export function troubleOf(status, detail, attempt, retryAfterS = NaN) {
  const backoffS = Math.min(2 ** attempt, LONGEST_S);
  /** @param {string} said @returns {Trouble} */
  const again = (said, retryS = backoffS) => ({ said, retryS, isGone: false });
  /** @param {string} said @returns {Trouble} */
  const final = (said) => ({ said, retryS: null, isGone: false });
  if (status === 0) return again(`${t("No network.")} ${KEPT}`);
  if (status === 401) return final(`${NOT_PAIRED} ${t("The walk stays on this phone until then.")}`);
  if (status === 404 || status === 410) return { said: t("The server begins anew."), retryS: backoffS, isGone: true };
  if (status === 409 || status === 423) return again(t("The server is busy with this file."));
  if (status === 429) return again(t("The server asks to go slower."), Number.isNaN(retryAfterS) ? 5 : retryAfterS);
  if (status === 507) return again(`${t("The server's disk is full. Free some of it.")} ${KEPT}`, LONGEST_S);
  if (status >= 500) return again(`${t("The server is in trouble ({{status}}).", { status })} ${KEPT}`);
  return final(translated(detail) || t("The server refuses the walk ({{status}}).", { status }));
}

/** The server's interface, and what it answers when it refuses. */

import { pairHere } from "../keeping/pairing.js";
import { t, translated } from "./words.js";

/**
 * What went wrong, in one line that people can read; `status` is 0 where no answer came. `levels` are those of a plan,
 * of which one is to be chosen.
 */
export class Problem extends Error {
  /** @param {string} detail @param {number} status @param {string[]} [levels] */
  constructor(detail, status, levels = []) {
    super(detail);
    this.name = "Problem";
    this.status = status;
    this.levels = levels;
  }
}

export const NO_ANSWER = t("The server does not answer: it is off, or this device is in another network.");
export const NOT_PAIRED = t("This device is not paired. Scan the code that the server shows, once.");

/**
 * Ask the server; gives what its JSON says, or null where it says nothing. Raises Problem.
 * @param {string} method @param {string} path @param {unknown} [body] sent as JSON
 * @param {Record<string, string>} [headers]
 * @param {{signal?: AbortSignal, keepalive?: boolean}} [more] what fetch is told besides
 */
export async function ask(method, path, body, headers = {}, more = {}) {
  /** @type {{method: string, headers: Record<string, string>, body?: string, signal?: AbortSignal, keepalive?: boolean}} */
  const options = { method, headers: { Accept: "application/json", ...headers }, ...more };
  if (body !== undefined) {
    options.body = JSON.stringify(body);
    options.headers["Content-Type"] = "application/json";
  }
  let response;
  try {
    response = await fetch(path, options);
  } catch {
    throw new Problem(NO_ANSWER, 0);
  }
  if (!response.ok) throw await problemOf(response);
  return response.status === 204 ? null : response.json();
}

/** What a refusal says. @param {Response} response @returns {Promise<Problem>} */
export async function problemOf(response) {
  const told = await response.json().catch(() => ({}));
  if (response.status === 401 && !response.url.endsWith("/session/code")) return new Problem(NOT_PAIRED, 401);
  const detail = typeof told.detail === "string" ? told.detail : told.title;
  return new Problem(translated(detail || "") || t("The server answered {{status}}.", { status: response.status }), response.status);
}

/**
 * What pairs in an address's fragment: a token, or a code that is good once; null where there is neither.
 * @param {string} fragment such as "#token=abc"
 * @returns {{kind: "token" | "code", secret: string} | null}
 */
export function secretIn(fragment) {
  const told = new URLSearchParams(fragment.replace(/^#/, ""));
  for (const kind of /** @type {const} */ (["token", "code"])) {
    const secret = told.get(kind);
    if (secret !== null) return { kind, secret: secret.trim() };
  }
  return null;
}

/**
 * Pair with what is in the address bar, if there is anything, and take it out of there as soon as the server
 * has answered. Raises Problem.
 * @param {Location} location @param {History} history
 */
export async function openSession(location, history) {
  const fragment = location.hash;
  if (secretIn(fragment) === null) return;
  const forget = () => history.replaceState(null, "", location.pathname + location.search);
  try {
    await beginSession(fragment);
  } catch (error) {
    if (!(error instanceof Problem) || error.status !== 0) forget();
    throw error;
  }
  forget();
}

/**
 * Hand a token or a code over for a cookie, and trust the key that lies beside it. Raises Problem.
 * @param {string} fragment such as "#token=abc&key=def"
 */
export async function beginSession(fragment) {
  const { kind, secret } = secretIn(fragment) ?? { kind: "token", secret: "" };
  if (kind === "code") await ask("POST", "/api/session/code", { code: secret });
  else await ask("POST", "/api/session", undefined, { Authorization: `Bearer ${secret}` });
  await pairHere(fragment, (await ask("GET", "/api/me")).id);
}

/** Pair with what someone typed or pasted: a token, or the whole address. @param {string} text */
export async function pairWith(text) {
  await beginSession(text.includes("#") ? text.slice(text.indexOf("#")) : `#token=${encodeURIComponent(text.trim())}`);
}

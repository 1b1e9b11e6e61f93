/** The server's interface, and what it answers when it refuses. */

import { pairHere } from "../keeping/store.js";
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
  const response = await fetched(path, options);
  if (!response.ok) throw await problemOf(response);
  return response.status === 204 ? null : response.json();
}

/** @param {string} path @param {RequestInit} options @returns {Promise<Response>} Raises Problem without an answer. */
async function fetched(path, options) {
  try {
    return await fetch(path, options);
  } catch {
    throw new Problem(NO_ANSWER, 0);
  }
}

/** What a refusal says to a phone. @param {Response} response @returns {Promise<Problem>} */
export async function problemOf(response) {
  const { status } = response;
  const told = documentOf(await response.text());
  if (status === 401 && !/\/session(\/code)?$/.test(response.url)) return new Problem(NOT_PAIRED, 401);
  return new Problem(lineOf(told) ?? t("The server answered {{status}}.", { status }), status);
}

/** What a refusal says; nothing where it is no problem document: a proxy's page, say. @param {string} text @returns {any} */
function documentOf(text) {
  try {
    return JSON.parse(text) ?? {};
  } catch {
    return {};
  }
}

/** @param {{detail?: unknown, title?: unknown}} told @returns {string | undefined} */
function lineOf({ detail, title }) {
  const line = [detail, title].find((each) => typeof each === "string" && each);
  return typeof line === "string" ? translated(line) : undefined;
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
async function beginSession(fragment) {
  const { kind, secret } = secretIn(fragment) ?? { kind: "token", secret: "" };
  if (kind === "code") await ask("POST", "/api/session/code", { code: secret });
  else await ask("POST", "/api/session", undefined, { Authorization: `Bearer ${secret}` });
  await pairHere(fragment, (await ask("GET", "/api/me")).id);
}

/** Pair with what someone typed or pasted: a token, or the whole address. @param {string} text */
export async function pairWith(text) {
  await beginSession(text.includes("#") ? text.slice(text.indexOf("#")) : `#token=${encodeURIComponent(text.trim())}`);
}

// As the desk asks: the answer itself, and a 401 is told to the page.

/** @typedef {{method?: string, json?: unknown, body?: BodyInit, headers?: Record<string, string>, keepalive?: boolean}} Asked */

/**
 * The answer to a request. Throws Problem. A 401 is also told to the page ("elfslam:signed-out").
 * @param {string} path @param {Asked} [asked] @returns {Promise<Response>}
 */
export async function request(path, { method = "GET", json, body, headers = {}, keepalive = false } = {}) {
  const sent = json === undefined ? headers : { ...headers, "Content-Type": "application/json" };
  const content = json === undefined ? body : JSON.stringify(json);
  const answer = await fetched(path, { method, headers: sent, body: content, keepalive });
  if (answer.ok) return answer;
  if (answer.status === 401) document.dispatchEvent(new CustomEvent("elfslam:signed-out"));
  const told = documentOf(await answer.text());
  const status = `${answer.status} ${answer.statusText}`.trim();
  throw new Problem(lineOf(told) ?? t("The server answered {{status}}.", { status }), answer.status, told.levels);
}

/** The JSON that the server answers; null where it answers nothing.
 * @param {string} path @param {Asked} [asked] @returns {Promise<any>} */
export async function requestJson(path, asked) {
  const answer = await request(path, asked);
  return answer.status === 204 ? null : answer.json();
}

/**
 * Fetch a file and hand it to the browser as a download. A refusal throws, so it can be shown.
 * @param {string} path @param {string} name if the server names none
 */
export async function download(path, name) {
  const answer = await request(path);
  const told = /filename\*?=(?:UTF-8'')?"?([^";]+)"?/i.exec(answer.headers.get("content-disposition") ?? "");
  const address = URL.createObjectURL(await answer.blob());
  const link = Object.assign(document.createElement("a"), {
    href: address,
    download: told ? decodeURIComponent(told[1]) : name,
  });
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

// Links that open a map without an account: `#link=…&key=…` behind the address of a page.

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

// Asking the server. What goes wrong is a Problem with one line for people.

import { NO_ANSWER, Problem } from "../shared/api.js";
import { t, translated } from "../shared/words.js";

export { Problem };

/**
 * @typedef {{method?: string, json?: unknown, body?: BodyInit, headers?: Record<string, string>, keepalive?: boolean}} Request
 */

/**
 * The answer to a request. Throws Problem. A 401 is also told to the page ("elfslam:signed-out").
 * @param {string} path @param {Request} [request] @returns {Promise<Response>}
 */
export async function ask(path, { method = "GET", json, body, headers = {}, keepalive = false } = {}) {
  const sent = json === undefined ? headers : { ...headers, "Content-Type": "application/json" };
  const content = json === undefined ? body : JSON.stringify(json);
  let answer;
  try {
    answer = await fetch(path, { method, headers: sent, body: content, keepalive });
  } catch {
    throw new Problem(NO_ANSWER, 0);
  }
  if (answer.ok) return answer;
  if (answer.status === 401) document.dispatchEvent(new CustomEvent("elfslam:signed-out"));
  const told = documentOf(await answer.text());
  const status = `${answer.status} ${answer.statusText}`.trim();
  throw new Problem(lineOf(told) ?? t("The server answered {{status}}.", { status }), answer.status, told.levels);
}

/** The JSON that the server answers; null where it answers nothing.
 * @param {string} path @param {Request} [request] @returns {Promise<any>} */
export async function askJson(path, request) {
  const answer = await ask(path, request);
  return answer.status === 204 ? null : answer.json();
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
 * Fetch a file and hand it to the browser as a download. A refusal throws, so it can be shown.
 * @param {string} path @param {string} name if the server names none
 */
export async function download(path, name) {
  const answer = await ask(path);
  const told = /filename\*?=(?:UTF-8'')?"?([^";]+)"?/i.exec(answer.headers.get("content-disposition") ?? "");
  const address = URL.createObjectURL(await answer.blob());
  const link = Object.assign(document.createElement("a"), {
    href: address,
    download: told ? decodeURIComponent(told[1]) : name,
  });
  link.click();
  setTimeout(() => URL.revokeObjectURL(address), 60_000);
}

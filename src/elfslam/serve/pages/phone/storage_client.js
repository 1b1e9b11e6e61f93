/** The page's side of the storage: orders as promises, and news of what has been kept. */

import { t, translated } from "../shared/words.js";

/**
 * @typedef {{isFull: boolean, said: string}} KeepingProblem in the reader's language
 * @typedef {KeepingProblem & {why: string}} Failure as the worker tells it: in English, or why in the browser's words
 * @typedef {{
 *   ask: (order: {do: string, [key: string]: unknown}) => Promise<any>,
 *   port: () => MessagePort,
 *   onKept: (heard: (news: {walk: string, sizes: Record<string, number>}) => void) => void,
 *   onProblem: (heard: (problem: KeepingProblem) => void) => void,
 * }} StorageClient
 * @typedef {{id: number, result?: unknown, problem?: Failure}} Answer
 * @typedef {{resolve: (result: unknown) => void, reject: (error: Error) => void}} Waiting
 */

/** @param {Failure} failure @returns {KeepingProblem} */
function inWords({ isFull, said, why }) {
  return { isFull, said: said ? translated(said) : t("The browser cannot keep the walk ({{why}}).", { why }) };
}

/** @returns {StorageClient} */
export function startStorage() {
  const worker = new Worker(new URL("./storage.worker.js", import.meta.url), { type: "module" });
  /** @type {Map<number, Waiting>} */
  const waiting = new Map();
  /** @type {Parameters<StorageClient["onKept"]>[0][]} */
  const keptListeners = [];
  /** @type {Parameters<StorageClient["onProblem"]>[0][]} */
  const problemListeners = [];
  let count = 0;

  /** @param {Answer} answer */
  const answered = ({ id, result, problem: failure }) => {
    const problem = failure && inWords(failure);
    const { resolve, reject } = /** @type {Waiting} */ (waiting.get(id));
    waiting.delete(id);
    if (problem) {
      problemListeners.forEach((heard) => heard(problem));
      reject(new Error(problem.said));
    } else {
      resolve(result);
    }
  };

  worker.onmessage = ({ data }) => {
    if (data.is === "answer") answered(data);
    if (data.is === "kept") keptListeners.forEach((heard) => heard(data));
    if (data.is === "problem") problemListeners.forEach((heard) => heard(inWords(data.problem)));
  };

  /** @type {StorageClient["ask"]} */
  const ask = (order) =>
    new Promise((resolve, reject) => {
      count += 1;
      waiting.set(count, { resolve, reject });
      worker.postMessage({ ...order, id: count });
    });

  const port = () => {
    const { port1, port2 } = new MessageChannel();
    worker.postMessage({ do: "serve", port: port1 }, [port1]);
    return port2;
  };

  return {
    ask,
    port,
    onKept: (heard) => keptListeners.push(heard),
    onProblem: (heard) => problemListeners.push(heard),
  };
}

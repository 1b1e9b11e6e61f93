/**
 * Sends a walk while it is being walked, a resumable upload (tus) per file, and finishes it when it is
 * over. It goes on through lost networks, full disks and reloads; the bytes come from the storage.
 */

import { NOT_PAIRED, Problem, ask } from "../shared/api.js";
import { t, translated } from "../shared/words.js";
import "../vendor/tus-js-client/tus.min.js";

const ENDPOINT = "/api/uploads";
const CHUNK_BYTES = 1 << 20;
/** Bytes are gathered for so long before they are sent. */
const BREATH_MS = 2000;
const GLANCE_MS = 200;
const LEAST_WAIT_S = 1;

/**
 * @typedef {{
 *   walk: string,
 *   state: import("./manifest.js").Walk,
 *   sizes: Record<string, number>,
 *   save: (reserve?: number) => Promise<void>,
 * }} Sent a walk on its way: its key, what is known of it, how much of each file is there
 * @typedef {{sent: Record<string, number>, trouble: string | null}} Progress
 * @typedef {import("./storage_client.js").StorageClient} StorageClient
 * @typedef {Problem & {wasMoving?: boolean, retryAfterS?: number}} Setback wasMoving: bytes were accepted before it
 * @typedef {{name: string, size_bytes: number, sha256: string}} SentFile
 * @typedef {{getStatus: () => number, getBody: () => string,
 *   getHeader: (name: string) => string | undefined}} Answer of the server, as the upload library gives it
 * @typedef {Error & {originalRequest?: object, originalResponse?: Answer | null}} UploadError
 */

/** Thrown where trying again is of no use. */
class Stuck extends Error {}

/**
 * @param {Sent} sent
 * @param {StorageClient} storage
 * @param {string[]} names of the files, `recording.json` last
 * @param {(progress: Progress) => void} tell
 * @param {AbortSignal} signal
 * @returns {Promise<object>} the recording as the server has it. Raises Stuck.
 */
export async function sendWalk(sent, storage, names, tell, signal) {
  /** @type {Progress} */
  const progress = { sent: {}, trouble: null };
  /** @param {Partial<Progress>} change */
  const report = (change) => tell(Object.assign(progress, change));
  /** @param {string} name @param {number} bytes */
  const note = (name, bytes) =>
    report({ sent: { ...progress.sent, [name]: bytes }, trouble: null });
  /** @template T @param {() => Promise<T>} work */
  const tried = (work) => persist(work, report, signal);
  await tried(() => createRecording(sent));
  const filled = await Promise.all(
    names.map(async (name) => {
      await moreThan(0, sizeOf(sent, name), () => sent.state.isOver, signal);
      if (sizeOf(sent, name)() === 0) return null;
      await tried(() => sendFile(sent, storage, name, note, signal));
      return name;
    }),
  );
  const there = filled.filter((name) => name !== null);
  const files = await Promise.all(there.map((name) => describeFile(sent, storage, name)));
  return tried(() => complete(sent, files));
}

/** @param {Sent} sent @param {SentFile[]} files */
async function complete(sent, files) {
  const path = `/api/recordings/${sent.state.recording}/complete`;
  try {
    return await ask("POST", path, { files, map: true });
  } catch (error) {
    if (/** @type {Problem} */ (error).status === 404) throw deletedThere();
    if (/** @type {Problem} */ (error).status !== 409) throw error;
    sent.state.uploads = {};
    await sent.save();
    throw new Stuck(`${/** @type {Problem} */ (error).message} ${t("Try again: the walk is then sent anew.")}`);
  }
}

function deletedThere() {
  return new Stuck(t("The server has deleted this walk. Discard it here too, or record it again."));
}

/**
 * Do the work again and again until it is done.
 * @template T @param {() => Promise<T>} work
 * @param {(change: Partial<Progress>) => void} report @param {AbortSignal} signal
 */
async function persist(work, report, signal) {
  for (let attempt = 0; ; attempt += 1) {
    signal.throwIfAborted();
    try {
      const result = await work();
      report({ trouble: null });
      return result;
    } catch (error) {
      if (signal.aborted) throw error;
      if (/** @type {Setback} */ (error).wasMoving) attempt = 0;
      if (!(error instanceof Problem)) throw error instanceof Stuck
        ? error
        : new Stuck(/** @type {Error} */ (error).message);
      const trouble = troubleOf(error.status, error.message, attempt, /** @type {Setback} */ (error).retryAfterS);
      if (trouble.retryS === null) throw new Stuck(trouble.said);
      report({ trouble: trouble.said });
      await patience(Math.max(trouble.retryS, LEAST_WAIT_S), signal);
    }
  }
}

/**
 * Waits, but no longer than until the network is back.
 * @param {number} seconds @param {AbortSignal} signal @returns {Promise<void>}
 */
function patience(seconds, signal) {
  return new Promise((resolve) => {
    const done = () => {
      clearTimeout(timer);
      window.removeEventListener("online", done);
      signal.removeEventListener("abort", done);
      resolve();
    };
    const timer = setTimeout(done, 1000 * seconds);
    window.addEventListener("online", done);
    signal.addEventListener("abort", done);
  });
}

/** @param {Sent} sent */
async function createRecording(sent) {
  const { state } = sent;
  if (state.recording !== null) return;
  /** @type {{name: string, device: string, start_pose?: number[]}} */
  const body = { name: state.name, device: state.device };
  if (state.startPose !== null) body.start_pose = state.startPose;
  state.recording = (await ask("POST", "/api/recordings", body)).id;
  await sent.save();
}

/**
 * One attempt at one file, from wherever the server has got to.
 * @param {Sent} sent @param {StorageClient} storage @param {string} name
 * @param {(name: string, bytes: number) => void} note @param {AbortSignal} signal
 * @returns {Promise<void>}
 */
function sendFile(sent, storage, name, note, signal) {
  const { state } = sent;
  let isMoving = false;
  return new Promise((resolve, reject) => {
    const upload = new /** @type {any} */ (globalThis).tus.Upload(name, {
      ...(state.uploads[name] ? { uploadUrl: state.uploads[name] } : { endpoint: ENDPOINT }),
      metadata: { recording: state.recording, filename: name },
      uploadLengthDeferred: true,
      chunkSize: CHUNK_BYTES,
      retryDelays: null,
      storeFingerprintForResuming: false,
      fingerprint: async () => null,
      fileReader: { openFile: async () => sourceOf(sent, storage, name, signal) },
      onUploadUrlAvailable: () => {
        state.uploads[name] = upload.url;
        sent.save().catch(reject);
      },
      onChunkComplete: (/** @type {number} */ _, /** @type {number} */ accepted) => {
        isMoving = true;
        note(name, accepted);
      },
      onSuccess: () => {
        note(name, sent.sizes[name] ?? 0);
        resolve();
      },
      onError: (/** @type {UploadError} */ error) => reject(problemOf(error, state, name, isMoving)),
    });
    signal.addEventListener("abort", () => {
      upload.abort();
      reject(signal.reason);
    });
    upload.start();
  });
}

/**
 * What the upload library reports, as a Problem; an upload that the server dropped is forgotten.
 * @param {UploadError} error @param {import("./manifest.js").Walk} state
 * @param {string} name @param {boolean} wasMoving
 */
function problemOf(error, state, name, wasMoving) {
  if (!("originalRequest" in error)) return error;
  const response = error.originalResponse;
  const status = response?.getStatus() ?? 0;
  if (status === 404 || status === 410) {
    if (!state.uploads[name]) return deletedThere();
    delete state.uploads[name];
  }
  const problem = new Problem(detailIn(response?.getBody()), status);
  return Object.assign(problem, {
    wasMoving,
    retryAfterS: Number.parseFloat(response?.getHeader("Retry-After") ?? ""),
  });
}

/** Empty where the body says nothing, or is none. @param {string | undefined} body @returns {string} */
function detailIn(body) {
  try {
    return JSON.parse(/** @type {string} */ (body)).detail ?? "";
  } catch {
    return "";
  }
}

/**
 * A file that grows while it is read; it is done when the walk is over and all of it was given.
 * @param {Sent} sent @param {StorageClient} storage @param {string} name @param {AbortSignal} signal
 */
function sourceOf(sent, storage, name, signal) {
  const size = sizeOf(sent, name);
  /** @param {number} start @param {number} end */
  const slice = async (start, end) => {
    await moreThan(start, size, () => sent.state.isOver, signal);
    const stop = Math.min(end, size());
    const isLast = sent.state.isOver && stop >= size();
    if (stop <= start) return { value: null, done: isLast };
    const bytes = await storage.ask({ do: "read", walk: sent.walk, name, start, end: stop });
    return { value: new Blob([bytes]), done: isLast };
  };
  return { size: null, slice, close: () => {} };
}

/** @param {Sent} sent @param {string} name */
const sizeOf = (sent, name) => () => sent.sizes[name] ?? 0;

/**
 * Waits until there is more than so much of it, or the walk is over.
 * @param {number} start @param {() => number} size @param {() => boolean} isOver @param {AbortSignal} signal
 */
async function moreThan(start, size, isOver, signal) {
  const since = performance.now();
  while (!isOver()) {
    signal.throwIfAborted();
    if (size() > start && performance.now() - since > BREATH_MS) return;
    await new Promise((resolve) => setTimeout(resolve, GLANCE_MS));
  }
}

/** @param {Sent} sent @param {StorageClient} storage @param {string} name @returns {Promise<SentFile>} */
async function describeFile(sent, storage, name) {
  const size = sent.sizes[name] ?? 0;
  const bytes = await storage.ask({ do: "read", walk: sent.walk, name, start: 0, end: size });
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
  const sha256 = Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
  return { name, size_bytes: size, sha256 };
}

// What stands in the way of sending, in words, and when to try again.

const KEPT = t("Everything is kept on this phone, and sending goes on by itself.");
const LONGEST_S = 15;

/**
 * @typedef {{said: string, retryS: number | null}} Trouble retryS: null where trying again is of no use
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
  const again = (said, retryS = backoffS) => ({ said, retryS });
  /** @param {string} said @returns {Trouble} */
  const final = (said) => ({ said, retryS: null });
  if (status === 0) return again(`${t("No network.")} ${KEPT}`);
  if (status === 401) return final(`${NOT_PAIRED} ${t("The walk stays on this phone until then.")}`);
  if (status === 404 || status === 410) return again(t("The server begins anew."));
  if (status === 409 || status === 423) return again(t("The server is busy with this file."));
  if (status === 429) return again(t("The server asks to go slower."), Number.isNaN(retryAfterS) ? 5 : retryAfterS);
  if (status === 507) return again(`${t("The server's disk is full. Free some of it.")} ${KEPT}`, LONGEST_S);
  if (status >= 500) return again(`${t("The server is in trouble ({{status}}).", { status })} ${KEPT}`);
  return final(translated(detail) || t("The server refuses the walk ({{status}}).", { status }));
}

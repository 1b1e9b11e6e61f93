// Recordings and other programs' logs, dropped or chosen, sent piece by piece so that they survive a bad network.

import { requestJson } from "../shared/api.js";
import { h, icon } from "../shared/dom.js";
import { say } from "./dialogs.js";
import { formatBytes, formatShare } from "../shared/format.js";
import { t, translated } from "../shared/words.js";

const PIECE_BYTES = 4 * 1024 * 1024;
const RETRY_MS = [500, 1000, 3000, 5000, 10_000, 20_000];

/** So end the files that the server looks into. */
export const ENDINGS = [".zip", ".txt", ".mat", ".tar.xz"];

/** @typedef {{key: number, name: string, sent: number, bytes: number, problem: string | null, stop: () => void}} Sending */

/**
 * Uploads and what they look like. @param {() => void} changed a file has come, or moved on
 * @param {() => void} arrived a file has come whole
 */
export function uploader(changed, arrived) {
  /** @type {Sending[]} */
  let sending = [];
  let count = 0;

  /** @param {Iterable<File>} files */
  function send(files) {
    const { taken, refused } = sorted([...files]);
    taken.forEach(begin);
    if (refused.length > 0) say(t("{{files}}: wanted what ends in {{endings}}; export the recording as .zip.", { files: refused.join(", "), endings: ENDINGS.join(", ") }), "problem");
  }

  /** @param {File} file */
  function begin(file) {
    count += 1;
    const entry = { key: count, name: file.name, sent: 0, bytes: file.size, problem: /** @type {string | null} */ (null), stop: () => {} };
    const upload = new /** @type {any} */ (globalThis).tus.Upload(file, {
      endpoint: "/api/uploads",
      chunkSize: PIECE_BYTES,
      retryDelays: RETRY_MS,
      metadata: { filename: file.name },
      removeFingerprintOnSuccess: true,
      onProgress(/** @type {number} */ sent) {
        entry.sent = sent;
        changed();
      },
      onSuccess(/** @type {any} */ success) {
        drop(entry.key);
        void sayWhatCame(file.name, success?.lastResponse?.getHeader("Elfslam-Recording"));
        arrived();
      },
      onError(/** @type {any} */ error) {
        entry.problem = refusalIn(error);
        changed();
      },
    });
    entry.stop = () => {
      void upload.abort(true).catch(() => {});
      drop(entry.key);
    };
    sending.push(entry);
    changed();
    upload.findPreviousUploads().then((/** @type {any[]} */ earlier) => {
      if (earlier.length > 0) upload.resumeFromPreviousUpload(earlier[0]);
      upload.start();
    });
  }

  /** @param {number} key */
  function drop(key) {
    sending = sending.filter((entry) => entry.key !== key);
    changed();
  }

  /** @param {string} key */
  function stop(key) {
    sending.find((entry) => String(entry.key) === key)?.stop();
  }

  return { send, stop, list: () => sendingList(sending), isBusy: () => sending.some((entry) => !entry.problem) };
}

/** Which files the server looks into. @template {{name: string}} F @param {F[]} files */
export function sorted(files) {
  const isTaken = (/** @type {F} */ { name }) => ENDINGS.some((ending) => name.toLowerCase().endsWith(ending));
  return { taken: files.filter(isTaken), refused: files.filter((file) => !isTaken(file)).map(({ name }) => name) };
}

/** A file that the server refused has not arrived. @param {string} name @param {string | undefined} id of its
 * recording, the first of several */
async function sayWhatCame(name, id) {
  const recording = id ? await requestJson(`/api/recordings/${encodeURIComponent(id)}`).catch(() => null) : null;
  if (recording?.state === "refused") say(t("{{name}} was refused: {{why}}", { name, why: translated(recording.refusal ?? "") }), "problem");
  else say(t("{{name}} has arrived.", { name }));
}

/** What the server said, else what went wrong. @param {any} error */
function refusalIn(error) {
  try {
    return translated(JSON.parse(error.originalResponse.getBody()).detail);
  } catch {
    return error.originalResponse ? t("The server answered {{status}}.", { status: error.originalResponse.getStatus() }) : t("The connection is lost; choose the file again to go on.");
  }
}

/** @param {Sending[]} sending */
function sendingList(sending) {
  return h("ul", { class: "sending", hidden: sending.length === 0 }, sending.map(({ key, name, sent, bytes, problem }) =>
    h("li", { "data-key": `sending-${key}` },
      h("span", { class: "name" }, name),
      problem ? h("span", { class: "problem" }, problem)
        : h("span", { class: "going" }, h("progress", { max: bytes || 1, value: sent, "aria-label": t("Upload of {{name}}", { name }) }),
          h("span", { class: "figures" }, `${t("{{done}} of {{total}}", { done: formatBytes(sent), total: formatBytes(bytes) })}, ${formatShare(sent / (bytes || 1))}`)),
      h("button", { type: "button", class: "icon", "data-action": "stop-upload", "data-id": String(key), "aria-label": t("Stop the upload of {{name}}", { name }), title: t("Stop") }, icon("stop")))));
}

/** Files dropped anywhere on the page; folders are told of. @param {(files: File[]) => void} receive */
export function onDrop(receive) {
  let depth = 0;
  const carriesFiles = (/** @type {DragEvent} */ event) => event.dataTransfer?.types.includes("Files") ?? false;
  const show = (/** @type {boolean} */ over) => document.body.classList.toggle("dropping", over);
  document.addEventListener("dragenter", (event) => {
    if (carriesFiles(event)) show((depth += 1) > 0);
  });
  document.addEventListener("dragleave", (event) => {
    if (carriesFiles(event)) show((depth -= 1) > 0);
  });
  document.addEventListener("dragover", (event) => {
    if (carriesFiles(event)) event.preventDefault();
  });
  document.addEventListener("drop", (event) => {
    if (!carriesFiles(event)) return;
    event.preventDefault();
    depth = 0;
    show(false);
    const folders = foldersIn(event);
    if (folders.length > 0) say(t("{{folders}}: wanted files, got a folder; pack it as .zip first.", { folders: folders.join(", ") }), "problem");
    const files = [...(event.dataTransfer?.files ?? [])].filter(({ name }) => !folders.includes(name));
    if (files.length > 0) receive(files);
  });
}

/** The names of the folders that are dropped: browsers give them as files without content.
 * @param {DragEvent} event @returns {string[]} */
function foldersIn(event) {
  const entries = [...(event.dataTransfer?.items ?? [])].map((item) => item.webkitGetAsEntry?.());
  return entries.flatMap((entry) => (entry?.isDirectory ? [entry.name] : []));
}

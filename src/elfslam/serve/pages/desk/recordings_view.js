// The recordings: what has come, what became of it.

import { request, requestJson } from "../shared/api.js";
import { h, icon } from "../shared/dom.js";
import { fileName, formatAgo, formatBytes, formatDuration, formatShare } from "../shared/format.js";
import { counted, t, translated, woven } from "../shared/words.js";
import { askToLocate, askToMap, confirmDelete, orSay, say } from "./dialogs.js";
import { stateOfJob } from "./jobs_view.js";
import {
  cell, chooseCell, chosenOf, deleteChosen, emptyPage, headOf, iconButton, lengthCell, matching, nothingFound,
  renameRecording, rowHead, sorted, stateCell, tableOf, toolbarOf,
} from "./lists.js";
import { isDemonstration } from "./maps_view.js";
import { isOpen, mappingOf } from "./store.js";

/** @typedef {import("./store.js").Known} Known */
/** @typedef {import("./store.js").Recording} Recording */
/** @typedef {import("./main.js").Desk} Desk */

const COLUMNS = [t("Chosen"), t("Recording"), t("When"), t("Length"), t("Size"), t("State"), t("Actions")];

/** @param {Desk} desk */
export function recordingsView({ known, uploads, chosen, orders, nowMs }) {
  const order = orders.recordings;
  const all = known.recordings.length;
  const add = h("label", { class: "button primary" }, icon("upload"), t("Add recordings"),
    h("input", { type: "file", accept: [...ENDINGS, ".xz"].join(","), multiple: true, class: "visually-hidden", name: "recordings" }));
  const shown = shownRecordings(known.recordings, order);
  const rows = shown.map((recording) => rowOf(recording, known, chosen, nowMs()));
  return h("div", { class: "page" },
    headOf(t("Recordings"), t("Walks from a phone, and what Sensor Logger, phyphox and other programs recorded: drop the files anywhere on this page."), add),
    uploads?.list(),
    all > 1 && toolbarOf(t("Recordings"), order, ["newest", "oldest", "name", "longest"], { shown: shown.length, all, chosen: deleteChosen(chosenOf(shown, chosen).length) }),
    rows.length > 0 ? tableOf(t("Recordings"), COLUMNS, rows) : all > 0 ? nothingFound(order.find) : nothing(known));
}

/** @param {Recording[]} recordings @param {import("./lists.js").Order} order */
function shownRecordings(recordings, { find, by }) {
  return sorted(matching(recordings, find, ({ name, device }) => [name, device]), by, ({ facts }) => facts?.duration_s);
}

/** @param {Known} known */
function nothing(known) {
  return emptyPage(known, "phone", t("No recordings yet"), 
    woven("Open {{page}} on a phone and walk, or drop recordings here. Without a phone, a simulated walker goes there for you.", { page: h("a", { href: "./" }, t("the phone page")) }),
    !known.maps.some(isDemonstration) && h("button", { type: "button", class: "button", "data-action": "load-demonstration" }, icon("layers"), t("Load the demonstration building")));
}

/** @param {Recording} recording @param {Known} known @param {Set<string>} chosen @param {number} nowMs */
function rowOf(recording, known, chosen, nowMs) {
  const { id, name, device, facts, created_utc } = recording;
  const ready = recording.state === "ready";
  return h("tr", { "data-key": id, role: "row" },
    chooseCell(id, name, chosen.has(id)),
    rowHead(h("a", { href: `#/recordings/${encodeURIComponent(id)}` }, name), h("small", null, device)),
    cell(t("When"), h("time", { datetime: created_utc, title: created_utc }, formatAgo(created_utc, nowMs))),
    lengthCell(formatDuration(facts?.duration_s), facts?.footsteps ? h("small", null, counted(facts.footsteps, "{{count, number}} footstep", "{{count, number}} footsteps")) : null),
    cell(t("Size"), formatBytes(bytesOf(recording))),
    stateCell(stateOf(recording, known, nowMs)),
    h("td", { class: "actions", role: "cell" },
      ready && h("button", { type: "button", class: "button small", "data-action": "map", "data-id": id }, icon("map"), h("span", null, t("Map", { context: "verb" }), h("span", { class: "visually-hidden" }, ` ${name}`))),
      ready && known.maps.length > 0 && iconButton("locate", "locate", id, t("Locate {{name}} in a map", { name })),
      ready && h("a", { class: "button icon", href: `/api/recordings/${encodeURIComponent(id)}/recording.zip`, download: `${fileName(name)}.zip`, "aria-label": t("Download {{name}}", { name }), title: t("Download as .zip") }, icon("download")),
      iconButton("edit", "rename", id, t("Rename {{name}}", { name })),
      iconButton("trash", "delete", id, t("Delete {{name}}", { name }), "danger")));
}

/** Bytes that have come. @param {Recording} recording @returns {number | null} */
export function bytesOf({ facts, files, uploads }) {
  if (Number.isFinite(facts?.bytes)) return facts.bytes;
  const kept = files.reduce((sum, file) => sum + file.size_bytes, 0);
  return kept + uploads.reduce((sum, upload) => sum + upload.offset_bytes, 0);
}

/** How much of what is coming has come; null while nobody knows how long it will be.
 * @param {Recording} recording @returns {number | null} 0 to 1 */
export function shareCome({ uploads }) {
  if (uploads.length === 0 || uploads.some(({ length_bytes }) => length_bytes === null)) return null;
  const whole = uploads.reduce((sum, upload) => sum + (upload.length_bytes ?? 0), 0);
  return whole === 0 ? 1 : uploads.reduce((sum, upload) => sum + upload.offset_bytes, 0) / whole;
}

/** Nobody walks for so long without a break. */
const BROKEN_OFF_MS = 2 * 3600 * 1000;

/** @param {Recording} recording @param {Known} known @param {number} nowMs */
export function stateOf(recording, known, nowMs) {
  if (recording.state === "refused") {
    return [h("span", { class: "badge", "data-verdict": "fail" }, t("Refused")), h("small", { class: "problem" }, translated(recording.refusal ?? ""))];
  }
  if (recording.state === "receiving") {
    const share = shareCome(recording);
    if (nowMs - Date.parse(recording.created_utc) > BROKEN_OFF_MS) {
      return [h("span", { class: "badge", "data-verdict": "fail" }, t("Broken off")),
        h("small", null, t("The rest is still on the phone: open this server's page there and continue sending. Or delete what has come."))];
    }
    return [h("span", { class: "badge pulse", "data-verdict": "doubt" }, t("Receiving")),
      share !== null && h("progress", { max: 1, value: share, "aria-label": t("Upload of {{name}}", { name: recording.name }) })];
  }
  const { job, map } = mappingOf(recording.id, known);
  const link = map && h("a", { href: `#/maps/${encodeURIComponent(map.id)}` }, t("See the map"));
  if (job && (isOpen(job) || (job.state === "failed"))) return [stateOfJob(job), link];
  return link ? [link] : [h("span", { class: "badge" }, t("Ready to map"))];
}

/** What goes with a recording. @param {number | null} bytes */
function goneWords(bytes) {
  return t("{{bytes}} leave this server and cannot be brought back. The maps made of it alone and the fixes found with it go too; floor maps merged with other walks stay.", { bytes: formatBytes(bytes) });
}

/** @param {Desk} desk */
export function recordingActions(desk) {
  const found = (/** @type {string} */ id) => desk.known.recordings.find((recording) => recording.id === id);
  return {
    async "load-demonstration"() {
      const loaded = await orSay(() => request("/api/demonstration", { method: "POST" }));
      await desk.now();
      if (loaded) location.hash = "#/maps";
    },
    async map(/** @type {string} */ id) {
      const recording = found(id);
      if (recording) await mapRecording(desk, recording);
    },
    async locate(/** @type {string} */ id) {
      const recording = found(id);
      if (recording) await post(desk, await askToLocate([recording], desk.known.maps), t("{{name}} is waiting to be located.", { name: recording.name }));
    },
    async rename(/** @type {string} */ id) {
      const recording = found(id);
      if (recording && (await renameRecording(recording))) await desk.now();
    },
    async delete(/** @type {string} */ id) {
      const recording = found(id);
      if (recording) await deleteRecording(desk, recording);
    },
    async "delete-chosen"() {
      const recordings = chosenOf(shownRecordings(desk.known.recordings, desk.orders.recordings), desk.chosen);
      const bytes = recordings.reduce((sum, recording) => sum + (bytesOf(recording) ?? 0), 0);
      if (!(await confirmDelete(counted(recordings.length, "{{count}} recording", "{{count}} recordings"), goneWords(bytes), recordings.map(({ name }) => name)))) return;
      await orSay(() => requestJson("/api/recordings/delete", { method: "POST", json: { ids: recordings.map(({ id }) => id) } }));
      await desk.now();
    },
    "stop-upload": (/** @type {string} */ id) => desk.uploads?.stop(id),
  };
}

/** Ask for a job and say so. @param {Desk} desk @param {object | null} job null where nobody wants one
 * @param {string} words */
async function post(desk, job, words) {
  if (!job) return;
  await orSay(async () => {
    await requestJson("/api/jobs", { method: "POST", json: job });
    say(words);
  });
  await desk.now();
}

/** @param {Desk} desk @param {Recording} recording */
export async function mapRecording(desk, recording) {
  await post(desk, await askToMap(recording), t("{{name}} is waiting to be mapped.", { name: recording.name }));
}

/** @param {Desk} desk @param {Recording} recording @returns {Promise<boolean>} whether it is gone */
export async function deleteRecording(desk, recording) {
  if (!(await confirmDelete(recording.name, goneWords(bytesOf(recording))))) return false;
  const gone = await orSay(() => request(`/api/recordings/${encodeURIComponent(recording.id)}`, { method: "DELETE" }));
  await desk.now();
  return gone;
}

// Recordings and other programs' logs, dropped or chosen, sent piece by piece so that they survive a bad network.

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
    const { taken, refused } = readable([...files]);
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
export function readable(files) {
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

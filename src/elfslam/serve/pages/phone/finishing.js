/** The end of a walk: the rest is sent, the server reads it and makes a map, and the page links there. */

import { ask } from "../shared/api.js";
import { formatBytes, formatDuration, missingWords, stageWords } from "../shared/format.js";
import { t, translated } from "../shared/words.js";
import { BASEBAND } from "./baseband.js";
import { SOUND_FILES, TABLE_FILES, cutsFor, lastTime } from "./manifest.js";
import { sendWalk } from "./sending.js";
import {
  at, offer, showFinishFacts, showFinishTrouble, showFinishing, showStage, showView, totalBytes,
} from "./view.js";
import { closeWalk } from "./walking.js";

/**
 * @typedef {import("./sending.js").Progress} Progress
 * @typedef {import("./sending.js").Sent} Sent
 * @typedef {{created_utc: string, doing: string, kind: string, problem: string | null, share: number | null} & (
 *   {state: "done", gave: {map: string, missing?: import("../shared/format.js").Missing[]}} | {state: "queued" | "running" | "failed" | "cancelled"}
 * )} Job as far as the page needs it
 */

const GLANCE_MS = 1500;
const MOST_FAILURES = 40;

/** @param {import("./manifest.js").Walk} state @returns {string[]} its files, the manifest last */
function filesOf({ kind }) {
  const { table, file } = SOUND_FILES[kind];
  return [file, table, ...TABLE_FILES, "recording.json"];
}

/**
 * A walk on its way to the server, whatever the page shows meanwhile.
 * @param {Sent} sent @param {import("./storage_client.js").StorageClient} storage
 */
export function startSending(sent, storage) {
  /** @type {{progress: Progress, tell: (progress: Progress) => void}} */
  const shown = { progress: { sent: {}, trouble: null }, tell: () => {} };
  const controller = new AbortController();
  /** @param {Progress} progress */
  const heard = (progress) => {
    shown.progress = progress;
    shown.tell(progress);
  };
  const done = sendWalk(sent, storage, filesOf(sent.state), heard, controller.signal);
  done.catch(() => {}); // whoever shows the end hears of it
  const stop = () => controller.abort(new DOMException("stopped", "AbortError"));
  return Object.assign(shown, { done, stop });
}

/**
 * Shows a walk until its map is there.
 * @param {Sent} sent @param {import("./storage_client.js").StorageClient} storage
 * @param {ReturnType<typeof startSending>} sending
 */
export async function showSending(sent, storage, sending) {
  showStage(t("Sending the walk"));
  showView("finish");
  offer();
  at("finish-name").textContent = sent.state.name;
  const { facts } = sent.state;
  showFinishFacts([
    [t("Length"), formatDuration(facts.seconds)],
    [t("Steps"), String(facts.steps)],
    [t("Size"), formatBytes(totalBytes(sent.sizes))],
  ]);
  sending.tell = (progress) => showProgress(sent, progress);
  showProgress(sent, sending.progress);
  try {
    await sending.done;
  } catch (thrown) {
    const error = /** @type {Error} */ (thrown);
    if (error.name === "AbortError") return;
    showFinishing(t("Not sent yet."), 0);
    showFinishTrouble(error.message);
    offer("send-again", "discard");
    return;
  }
  await storage.ask({ do: "remove", walk: sent.walk });
  await followMap(/** @type {string} */ (sent.state.recording));
}

/** @param {Sent} walk @param {Progress} progress */
function showProgress({ sizes, state }, { sent, trouble }) {
  const total = totalBytes(sizes);
  const there = totalBytes(sent);
  showFinishTrouble(trouble);
  const isAll = there >= total && state.isOver;
  const said = isAll
    ? t("The server reads the walk.")
    : t("{{there}} of {{total}} are on the server.", { there: formatBytes(there), total: formatBytes(total) });
  showFinishing(said, isAll ? null : there / Math.max(total, 1));
}

/**
 * Follows the job that makes the map. What fails here is not lost: the walk is on the server.
 * @param {string} recording
 */
async function followMap(recording) {
  showFinishTrouble(null);
  showStage(t("Making the map"));
  showFinishing(t("The walk is on the server. Its map is being made."), null);
  offer("another");
  let failures = 0;
  for (;;) {
    const job = await latestJob(recording).catch(() => undefined);
    failures = job === undefined ? failures + 1 : 0;
    if (failures > MOST_FAILURES) return showFinishTrouble(t("The server does not answer; look for the map later."));
    if (job && showJob(job)) return undefined;
    await new Promise((resolve) => setTimeout(resolve, GLANCE_MS));
  }
}

/** @param {string} recording @returns {Promise<Job | null>} */
async function latestJob(recording) {
  /** @type {Job[]} */
  const jobs = await ask("GET", `/api/jobs?recording=${encodeURIComponent(recording)}`);
  return jobs.filter((job) => job.kind === "map").sort((a, b) => (a.created_utc < b.created_utc ? 1 : -1))[0] ?? null;
}

/** @param {Job} job @returns {boolean} whether there is nothing more to wait for */
function showJob(job) {
  if (job.state === "done") {
    showStage(t("The map is ready"));
    showFinishing(t("The map is ready."), 1);
    showFinishTrouble(missingWords(job.gave.missing) || null);
    at("see-map").href = `desk.html#/maps/${encodeURIComponent(job.gave.map)}`;
    offer("see-map", "another");
    at("see-map").focus();
    return true;
  }
  if (job.state === "failed" || job.state === "cancelled") {
    showStage(t("No map was made"));
    showFinishing(t("The walk is on the server, without a map."), 0);
    showFinishTrouble(translated(job.problem ?? "") || t("The work was cancelled."));
    offer("another");
    return true;
  }
  const doing = job.state === "running" && job.doing ? stageWords(job.doing) : t("waiting for its turn");
  showFinishing(t("The map is being made: {{doing}}.", { doing }), job.share);
  return false;
}

// Walks that an earlier page left behind: made whole again, so that they can be sent or discarded.

const WHOLE_FRAME_S = 0.08;

/**
 * @typedef {import("./storage_client.js").StorageClient} StorageClient
 * @typedef {import("./manifest.js").Walk} Walk
 */

/**
 * @param {StorageClient} storage
 * @returns {Promise<Sent[]>} walks that hold anything; empty ones are cleared away
 */
export async function findUnfinished(storage) {
  /** @type {{walk: string, state: Walk | null, sizes: Record<string, number>}[]} */
  const found = await storage.ask({ do: "list" });
  const walks = [];
  for (const { walk, state, sizes } of found) {
    if (state === null) await storage.ask({ do: "remove", walk });
    else walks.push(makeSent(storage, walk, state, sizes));
  }
  return walks;
}

/** Bytes held beside the state of a walk, so that it can be closed when the phone is full. */
const RESERVE = 1 << 15;

/**
 * @param {StorageClient} storage @param {string} walk @param {Walk} state @param {Record<string, number>} sizes
 * @returns {Sent}
 */
export function makeSent(storage, walk, state, sizes) {
  const save = (reserve = state.isOver ? 0 : RESERVE) => storage.ask({ do: "save", walk, state, reserve });
  return { walk, state, sizes, save };
}

/**
 * A walk that nobody stopped is cut to what is whole, and closed.
 * @param {Sent} sent @param {StorageClient} storage @param {string} software
 */
export async function mend(sent, storage, software) {
  if (sent.state.isOver) return;
  await mendFiles(sent, storage);
  await closeWalk(sent, storage, software);
}

/**
 * Cuts the files of a walk that nobody stopped to what is whole: it may be closed, or go on. What was cut is sent
 * anew, as the server may have had more of it.
 * @param {Sent} sent @param {StorageClient} storage
 */
export async function mendFiles(sent, storage) {
  const { walk, state, sizes } = sent;
  const { table, file, headerBytes } = SOUND_FILES[state.kind];
  /** @param {string} name */
  const text = async (name) => {
    const bytes = await storage.ask({ do: "read", walk, name, start: 0, end: sizes[name] ?? 0 });
    return new TextDecoder().decode(bytes);
  };
  const frames = await text(table);
  /** @type {Record<string, string>} */
  const tables = {};
  for (const name of TABLE_FILES) tables[name] = await text(name);
  const frameBytes = frameBytesOf(state);
  const cuts = cutsFor(
    { table: frames, frameBytes, headerBytes, fileBytes: sizes[file] ?? 0 },
    tables,
  );
  /** @param {string} name @param {number | undefined} size */
  const cut = async (name, size) => {
    if (size === undefined) return;
    await storage.ask({ do: "truncate", walk, name, size });
    sizes[name] = size;
    delete state.uploads[name];
  };
  await cut(table, cuts.sound.table);
  await cut(file, cuts.sound.file);
  for (const name of TABLE_FILES) await cut(name, cuts.tables[name]);
  await cut("recording.json", sizes["recording.json"] ? 0 : undefined);
  const keptS = lastTime(frames);
  if (keptS > 0) state.facts.seconds = keptS + WHOLE_FRAME_S;
}

/** @param {Walk} state */
function frameBytesOf({ kind, rateHz }) {
  if (kind === "baseband") return 4 * BASEBAND.frameSamples;
  return 2 * Math.round(WHOLE_FRAME_S * rateHz);
}

/** recording.json, from what is known of a walk. */

import { BASEBAND } from "./baseband.js";

/**
 * What is kept of a walk beside its bytes.
 * @typedef {{
 *   version: 1, name: string, device: string, startPose: number[] | null, startUtc: string,
 *   kind: "baseband" | "whole", rateHz: number, scale?: number, chirp: import("../stages/chirp.js").Chirp,
 *   capture: object, facts: Facts, recording: string | null, uploads: Record<string, string>,
 *   isOver: boolean, marks?: string[], taps?: Record<string, [number, number]>, tappedOn?: string,
 * }} Walk marks: names of the places that the walker marked; taps: where some of them are on the plan of the map
 *   `tappedOn`
 * @typedef {{seconds: number, steps: number, frames: number, missed: number, latencyS: number | null,
 *   jumps: {t_s: number, by_s: number}[], gaps: {t_s: number, lost_s: number}[], others: number}} Facts
 *   others: chirps of other phones that were heard
 */

/** @type {Facts} */
export const NO_FACTS = {
  seconds: 0, steps: 0, frames: 0, missed: 0, latencyS: null, jumps: [], gaps: [], others: 0,
};

/** @param {Walk} walk @param {string} software @returns {string} */
export function manifestOf(walk, software) {
  const { facts } = walk;
  const manifest = {
    format_version: 1,
    name: walk.name,
    device: walk.device,
    start_utc: walk.startUtc,
    start_pose: walk.startPose,
    ...(walk.tappedOn ? { tapped_on: walk.tappedOn } : {}),
    chirp: walk.chirp,
    audio: facts.frames > 0 ? { rate_hz: walk.rateHz, channels: 1, samples: Math.round(facts.seconds * walk.rateHz) } : null,
    ...(walk.kind === "baseband" && facts.frames > 0 ? { baseband: basebandOf(walk) } : {}),
    software,
    capture: {
      ...walk.capture,
      latency_s: facts.latencyS,
      frames: facts.frames,
      missed: facts.missed,
      jumps: facts.jumps,
      gaps: facts.gaps,
      steps: facts.steps,
      others: facts.others,
    },
  };
  return `${JSON.stringify(manifest, null, 2)}\n`;
}

/**
 * The scale is that of frames whose row names none: those of walks begun on an earlier page.
 * @param {{scale?: number, rateHz: number}} facts
 */
function basebandOf({ scale = 1 / 32767, rateHz }) {
  return {
    rate_hz: BASEBAND.rateHz,
    centre_hz: BASEBAND.centreHz,
    frame_samples: BASEBAND.frameSamples,
    scale,
    source_rate_hz: rateHz,
    lead_s: BASEBAND.leadS,
  };
}

/**
 * The phone, as far as the browser tells.
 * @param {{userAgent: string, userAgentData?: {getHighEntropyValues: (names: string[]) => Promise<any>}}} browser
 */
export async function describeDevice({ userAgent, userAgentData }) {
  const hints = await userAgentData?.getHighEntropyValues(["model", "platform"]).catch(() => null);
  if (hints?.model) return `${hints.model}, ${hints.platform}`;
  return deviceIn(userAgent);
}

/** @param {string} userAgent */
export function deviceIn(userAgent) {
  const inside = /\(([^)]*)\)/.exec(userAgent)?.[1] ?? "";
  const parts = inside.split(";").map((part) => part.trim());
  const android = parts.findIndex((part) => part.startsWith("Android"));
  if (android >= 0) return [parts[android + 1], parts[android]].filter(Boolean).join(", ");
  return parts[0] || "unknown";
}

// What has to be cut off a walk that ended without being stopped, so that its files agree again.

/** When each chirp was played. */
export const CHIRPS = "chirps.csv";
/** When the walker was at a place that they gave a name. */
export const CHECKPOINTS = "checkpoints.csv";
const TABLES = ["accelerometer.csv", "gyroscope.csv", CHIRPS, CHECKPOINTS];
export const SOUND_FILES = {
  baseband: { table: "baseband.csv", file: "baseband.iq", headerBytes: 0 },
  whole: { table: "frames.csv", file: "frames.wav", headerBytes: 44 },
};
export const TABLE_FILES = TABLES;

/**
 * Sizes to cut files down to; only those that are too long are named.
 * @param {{table: string, frameBytes: number, headerBytes: number, fileBytes: number}} sound the text of
 *   the table of frames, and how long the file of frames is
 * @param {Record<string, string>} tables text of the other tables
 * @returns {{sound: {table?: number, file?: number}, tables: Record<string, number>}}
 */
export function cutsFor(sound, tables) {
  const rows = wholeRows(sound.table);
  const frames = Math.max(Math.floor((sound.fileBytes - sound.headerBytes) / sound.frameBytes), 0);
  const count = Math.min(rows.length - 1, frames);
  const tableBytes = rows.slice(0, count + 1).join("").length;
  const fileBytes = sound.headerBytes + count * sound.frameBytes;
  /** @type {ReturnType<typeof cutsFor>} */
  const cuts = { sound: {}, tables: {} };
  if (tableBytes < sound.table.length) cuts.sound.table = tableBytes;
  if (fileBytes < sound.fileBytes) cuts.sound.file = fileBytes;
  for (const [name, text] of Object.entries(tables)) {
    const whole = wholeRows(text).join("").length;
    if (whole < text.length) cuts.tables[name] = whole;
  }
  return cuts;
}

/** Lines that end, with their ends. @param {string} text @returns {string[]} */
function wholeRows(text) {
  return text.match(/[^\n]*\n/g) ?? [];
}

/** @param {string} table @returns {number} time of the last row, 0 where there is none */
export function lastTime(table) {
  const rows = wholeRows(table);
  return rows.length > 1 ? Number.parseFloat(rows[rows.length - 1]) : 0;
}

// What is told of a recording, and what each of its files holds. Pure.

import { locale, t } from "../../shared/words.js";

/** @typedef {import("../store.js").Recording} Recording */
/** @typedef {{sensors: {name: string, readings: number, rate_hz: number | null}[], curves: import("./curves.js").Curve[], chirps_played: number | null, chirps_heard_share: number | null}} Look */

/** Sensors as people call them. @type {Record<string, string>} */
const SENSORS = {
  audio: t("Sound"),
  imu: t("Motion"),
  orientation: t("Attitude"),
  odometry: t("Odometry"),
  magnetometer: t("Magnetic field"),
  wifi: t("Wi-Fi scans"),
  emr: t("Mains hum"),
};

/** Programs whose recordings are taken in. @type {Record<string, string>} */
const PROGRAMS = {
  mall: "Indoor Location Competition",
  magnetic: t("Magnetic walks (.mat)"),
  sensorlogger: "Sensor Logger",
  phyphox: "phyphox",
  getsensordata: "GetSensorData",
  ronin: "RoNIN",
};

/** What a file of a recording holds. @type {Record<string, string>} */
const FILES = {
  "accelerometer.csv": t("Acceleration with gravity, m/s²"),
  "gyroscope.csv": t("Turn rates, rad/s"),
  "magnetometer.csv": t("Magnetic field, µT"),
  "orientation.csv": t("Attitude as quaternions"),
  "wifi.csv": t("Access points seen, dBm"),
  "emr.csv": t("Harmonics of the mains"),
  "chirps.csv": t("When chirps were played"),
  "audio.flac": t("Sound"),
  "audio.wav": t("Sound"),
  "frames.flac": t("Sound around each chirp"),
  "frames.wav": t("Sound around each chirp"),
  "frames.csv": t("When each piece of sound begins"),
  "baseband.iq": t("The chirp band alone"),
  "baseband.csv": t("When each piece of sound begins"),
  "odometry.tum": t("The device's own odometry"),
  "odometry_sigma.csv": t("How far that can be trusted"),
  "truth.tum": t("Where the walk is known to have been"),
  "waypoints.csv": t("Places that were passed"),
  "recording.json": t("Name, device, chirp"),
};

/** Name and value of what is told, in order. @param {Recording} recording @param {Look | null} look null
 * until the server has read the sensors
 * @param {{duration: string, bytes: string, count: (count: number) => string}} shared
 * @returns {[string, string][]} */
export function factsOf({ facts }, look, { duration, bytes, count }) {
  /** @type {[string, string | null][]} */
  const told = [
    [t("Duration"), duration],
    [t("Footsteps"), Number.isFinite(facts?.footsteps) ? count(facts.footsteps) : null],
    [t("Size"), bytes],
    [t("Recorded with"), facts?.imported ? (PROGRAMS[facts.imported] ?? String(facts.imported)) : null],
    [t("Damaged lines left out"), facts?.damaged_lines > 0 ? count(facts.damaged_lines) : null],
    [t("Noted when it was read"), facts?.notes?.length ? facts.notes.join("; ") : null],
    [t("Chirps played"), look?.chirps_played ? count(look.chirps_played) : null],
    [t("Chirps heard"), heardText(look?.chirps_heard_share ?? null)],
    ...rates(facts, look),
  ];
  return told.flatMap(([name, value]) => (value === null ? [] : [[name, value]]));
}

/** @param {number | null} share of the chirps that were due, 0 to 1; null without sound */
function heardText(share) {
  if (share === null) return null;
  return share === 0 ? t("none") : `${Math.floor(share * 100)} %`;
}

/** @param {any} facts @param {Look | null} look @returns {[string, string][]} */
function rates(facts, look) {
  if (look === null) return (facts?.sensors ?? []).map((/** @type {string} */ name) => [SENSORS[name] ?? name, "…"]);
  return look.sensors.map(({ name, readings, rate_hz }) => [SENSORS[name] ?? name, name === "wifi" || rate_hz === null ? String(readings) : rateText(rate_hz)]);
}

/** @param {number} rate_hz @returns {string} 48 kHz, 44.1 kHz, 100 Hz, 0.8 Hz */
export function rateText(rate_hz) {
  if (rate_hz >= 1000) return `${shortly(Number((rate_hz / 1000).toFixed(1)))} kHz`;
  return `${shortly(rate_hz >= 10 ? Math.round(rate_hz) : Number(rate_hz.toPrecision(2)))} Hz`;
}

/** With no more digits than it has. @param {number} value */
function shortly(value) {
  return value.toLocaleString(locale, { useGrouping: false });
}

/** Files to be taken away, tables first. @template {{name: string, size_bytes: number}} T @param {T[]} files
 * @returns {(T & {words: string})[]} */
export function filesOf(files) {
  const rank = (/** @type {string} */ name) => (name.endsWith(".csv") ? 0 : 1);
  return [...files].sort((a, b) => rank(a.name) - rank(b.name) || a.name.localeCompare(b.name))
    .map((file) => ({ ...file, words: FILES[file.name] ?? "" }));
}

// What is told of a recording, and what each of its files holds. Pure.

/** @typedef {import("../store.js").Recording} Recording */
/** @typedef {{sensors: {name: string, readings: number, rate_hz: number | null}[], curves: import("./curves.js").Curve[], chirps_played: number | null, chirps_heard_share: number | null}} Look */

/** Sensors as people call them. @type {Record<string, string>} */
const SENSORS = {
  audio: "Sound",
  imu: "Motion",
  orientation: "Attitude",
  odometry: "Odometry",
  magnetometer: "Magnetic field",
  wifi: "Wi-Fi scans",
  emr: "Mains hum",
};

/** Programs whose recordings are taken in. @type {Record<string, string>} */
const PROGRAMS = {
  mall: "Indoor Location Competition",
  magnetic: "Magnetic walks (.mat)",
  sensorlogger: "Sensor Logger",
  phyphox: "phyphox",
  getsensordata: "GetSensorData",
  ronin: "RoNIN",
};

/** What a file of a recording holds. @type {Record<string, string>} */
const FILES = {
  "accelerometer.csv": "Acceleration with gravity, m/s²",
  "gyroscope.csv": "Turn rates, rad/s",
  "magnetometer.csv": "Magnetic field, µT",
  "orientation.csv": "Attitude as quaternions",
  "wifi.csv": "Access points seen, dBm",
  "emr.csv": "Harmonics of the mains",
  "chirps.csv": "When chirps were played",
  "audio.flac": "Sound",
  "audio.wav": "Sound",
  "frames.flac": "Sound around each chirp",
  "frames.wav": "Sound around each chirp",
  "frames.csv": "When each piece of sound begins",
  "baseband.iq": "The chirp band alone",
  "baseband.csv": "When each piece of sound begins",
  "odometry.tum": "The device's own odometry",
  "odometry_sigma.csv": "How far that can be trusted",
  "truth.tum": "Where the walk is known to have been",
  "waypoints.csv": "Places that were passed",
  "recording.json": "Name, device, chirp",
};

/** Name and value of what is told, in order. @param {Recording} recording @param {Look | null} look null
 * until the server has read the sensors
 * @param {{duration: string, bytes: string, count: (count: number) => string}} shared
 * @returns {[string, string][]} */
export function factsOf({ facts }, look, { duration, bytes, count }) {
  /** @type {[string, string | null][]} */
  const told = [
    ["Duration", duration],
    ["Footsteps", Number.isFinite(facts?.footsteps) ? count(facts.footsteps) : null],
    ["Size", bytes],
    ["Recorded with", facts?.imported ? (PROGRAMS[facts.imported] ?? String(facts.imported)) : null],
    ["Damaged lines left out", facts?.damaged_lines > 0 ? count(facts.damaged_lines) : null],
    ["Chirps played", look?.chirps_played ? count(look.chirps_played) : null],
    ["Chirps heard", heardText(look?.chirps_heard_share ?? null)],
    ...rates(facts, look),
  ];
  return told.flatMap(([name, value]) => (value === null ? [] : [[name, value]]));
}

/** @param {number | null} share of the chirps that were due, 0 to 1; null without sound */
function heardText(share) {
  if (share === null) return null;
  return share === 0 ? "none" : `${Math.floor(share * 100)} %`;
}

/** @param {any} facts @param {Look | null} look @returns {[string, string][]} */
function rates(facts, look) {
  if (look === null) return (facts?.sensors ?? []).map((/** @type {string} */ name) => [SENSORS[name] ?? name, "…"]);
  return look.sensors.map(({ name, readings, rate_hz }) => [SENSORS[name] ?? name, name === "wifi" || rate_hz === null ? String(readings) : rateText(rate_hz)]);
}

/** @param {number} rate_hz @returns {string} 48 kHz, 44.1 kHz, 100 Hz, 0.8 Hz */
export function rateText(rate_hz) {
  if (rate_hz >= 1000) return `${Number((rate_hz / 1000).toFixed(1))} kHz`;
  return `${rate_hz >= 10 ? Math.round(rate_hz) : Number(rate_hz.toPrecision(2))} Hz`;
}

/** Files to be taken away, tables first. @template {{name: string, size_bytes: number}} T @param {T[]} files
 * @returns {(T & {words: string})[]} */
export function filesOf(files) {
  const rank = (/** @type {string} */ name) => (name.endsWith(".csv") ? 0 : 1);
  return [...files].sort((a, b) => rank(a.name) - rank(b.name) || a.name.localeCompare(b.name))
    .map((file) => ({ ...file, words: FILES[file.name] ?? "" }));
}

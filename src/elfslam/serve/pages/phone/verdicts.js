/** What the probe found, in words: a line per check, and what to do about it. */

import { formatLevel } from "../shared/format.js";

/**
 * @typedef {"pass" | "doubt" | "fail"} Verdict
 * @typedef {{name: string, verdict: Verdict, said: string}} Check
 * @typedef {import("./probe.js").Measured} Measured
 * @typedef {{label: string, contextRateHz: number, settings: MediaTrackSettings,
 *   outputLatencyS: number}} Ears what the browser says of microphone and sound
 */

const DISTORTIONS = {
  echoCancellation: "echo cancellation",
  noiseSuppression: "noise suppression",
  autoGainControl: "automatic gain",
};
const SAFE_RATE_HZ = 44100;

/**
 * Every check, in the order in which they are shown.
 * @param {Ears} ears @param {Measured} measured
 * @param {{rateHz: number, gravityMps2: number}} motion
 * @param {number | null} freeBytes null where the browser does not say
 * @returns {Check[]}
 */
export function judge(ears, measured, motion, freeBytes) {
  return [
    judgeMicrophone(ears),
    judgeProcessing(ears.settings),
    judgeLevel(measured),
    judgeBands(measured),
    judgeSteadiness(measured),
    judgeMotion(motion),
    judgeRoom(freeBytes),
  ];
}

/** @param {Check[]} checks @returns {{verdict: Verdict, said: string}} */
export function summarise(checks) {
  const failed = checks.filter((check) => check.verdict === "fail");
  const doubted = checks.filter((check) => check.verdict === "doubt");
  if (failed.length > 0) {
    return { verdict: "fail", said: `Not yet: ${named(failed)}. See below what to do, then check again.` };
  }
  if (doubted.length > 0) {
    return { verdict: "doubt", said: `This phone may do it. In doubt: ${named(doubted)}.` };
  }
  return { verdict: "pass", said: "This phone can do it." };
}

/** @param {Check[]} checks */
function named(checks) {
  return checks.map(({ name }) => name[0].toLowerCase() + name.slice(1)).join(", ");
}

/** @param {Ears} ears @returns {Check} */
function judgeMicrophone({ label, contextRateHz, settings, outputLatencyS }) {
  const name = "Microphone";
  const rateHz = settings.sampleRate ?? contextRateHz;
  if (/bluetooth|airpods|buds|hands-?free|headset/i.test(label)) {
    return fail(name, `“${label}” is a headset. Take it off: the phone’s own microphone and loudspeaker are needed.`);
  }
  if (rateHz < SAFE_RATE_HZ) {
    return fail(name, `It hears only up to ${kilohertz(rateHz / 2)}. Switch Bluetooth off and check again.`);
  }
  if (outputLatencyS > 0.12) {
    const late = `${Math.round(outputLatencyS * 1000)} ms late`;
    return doubt(name, `Sound leaves the phone ${late}. If a Bluetooth loudspeaker is connected, switch it off.`);
  }
  const both = rateHz === contextRateHz ? "" : `, sound runs at ${kilohertz(contextRateHz)}`;
  return pass(name, `The phone’s own, at ${kilohertz(rateHz)}${both}.`);
}

/** @param {MediaTrackSettings} settings @returns {Check} */
function judgeProcessing(settings) {
  const name = "Untouched sound";
  const keys = /** @type {(keyof typeof DISTORTIONS)[]} */ (Object.keys(DISTORTIONS));
  const on = keys.filter((key) => settings[key] === true || typeof settings[key] === "string");
  if (on.length > 0) {
    const which = on.map((key) => DISTORTIONS[key]).join(" and ");
    return fail(name, `The browser keeps ${which} on, which wipes out the chirps. Try another browser.`);
  }
  const unknown = keys.filter((key) => settings[key] === undefined);
  if (unknown.length > 0) {
    const which = unknown.map((key) => DISTORTIONS[key]).join(" and ");
    return doubt(name, `The browser does not say whether ${which} is off. The levels below tell.`);
  }
  return pass(name, "Echo cancellation, noise suppression and automatic gain are off.");
}

/** @param {Measured} measured @returns {Check} */
function judgeLevel({ peak, clippedShare, silentShare }) {
  const name = "Loudness";
  const level = formatLevel(20 * Math.log10(Math.max(peak, 1e-6)));
  if (silentShare > 0.9) {
    return fail(name, "The microphone gives silence. Allow it in the phone’s settings, and unmute it.");
  }
  if (clippedShare > 0.001) {
    return fail(name, "Far too loud: the microphone is overdriven. Turn the media volume down.");
  }
  if (peak < 0.0005) {
    const advice = "Turn the media volume up and uncover loudspeaker and microphone.";
    return fail(name, `The chirps are hardly heard (${level}). ${advice}`);
  }
  if (peak < 0.004) return doubt(name, `Soft (${level}). Turn the media volume up.`);
  return pass(name, `The chirps are heard at ${level} of full scale.`);
}

/** @param {Measured} measured @returns {Check} */
function judgeBands({ subbands }) {
  const name = "15 to 20 kHz";
  const deaf = subbands.filter((band) => band.snrDb < 6);
  const weak = subbands.filter((band) => band.snrDb < 15);
  if (deaf.length > 1) return fail(name, `Nothing at ${edges(deaf)}: this phone or browser cuts the sound off there.`);
  if (weak.length > 0) return doubt(name, `Weak at ${edges(weak)}. Turn the volume up, or find a quieter place.`);
  const least = Math.min(...subbands.map((band) => band.snrDb));
  return pass(name, `At least ${Math.round(least)} dB above the noise in every kilohertz.`);
}

/** @param {Measured} measured @returns {Check} */
function judgeSteadiness({ heard, frames, jitterS, contrast }) {
  const name = "Steady timing";
  const share = `${heard} of ${frames} chirps`;
  const off = `${(jitterS * 1000).toFixed(1)} ms early or late`;
  if (heard < 0.5 * frames) {
    return fail(name, `Only ${share} were heard. Turn the media volume up, and keep the loudspeaker free.`);
  }
  if (jitterS > 0.002) return fail(name, `The chirps come ${off}. Close other apps and check again.`);
  if (heard < 0.9 * frames || contrast < 12) return doubt(name, `${share} were clear. A quieter place helps.`);
  if (jitterS > 0.0003) return doubt(name, `The chirps come ${off}.`);
  return pass(name, `${share} came straight from loudspeaker to microphone, to within ${microseconds(jitterS)}.`);
}

/** @param {{rateHz: number, gravityMps2: number}} motion @returns {Check} */
function judgeMotion({ rateHz, gravityMps2 }) {
  const name = "Motion";
  if (rateHz === 0) return fail(name, "No motion arrives. Allow motion sensors for this page; a computer has none.");
  const rate = `${Math.round(rateHz)} readings a second`;
  if (rateHz < 20) return fail(name, `Only ${rate}; 50 are wanted. Switch the battery saver off.`);
  if (!(gravityMps2 > 5 && gravityMps2 < 15)) {
    return fail(name, `Gravity reads ${gravityMps2.toFixed(1)} m/s², wanted 9.8. Try another browser.`);
  }
  if (rateHz < 45) return doubt(name, `${rate}; 50 would be better. Switch the battery saver off.`);
  return pass(name, `${rate}, gravity at ${gravityMps2.toFixed(1)} m/s².`);
}

/** @param {number | null} freeBytes @returns {Check} */
function judgeRoom(freeBytes) {
  const name = "Room on this phone";
  if (freeBytes === null) return pass(name, "The browser does not say how much is free; ten minutes take 15 MB.");
  const megabytes = Math.round(freeBytes / 1e6);
  if (megabytes < 20) return fail(name, `${megabytes} MB are free; ten minutes take 15 MB. Delete something.`);
  if (megabytes < 100) return doubt(name, `${megabytes} MB are free; ten minutes take 15 MB.`);
  return pass(name, megabytes > 2000 ? `${Math.round(megabytes / 1000)} GB are free.` : `${megabytes} MB are free.`);
}

/** @param {Measured["subbands"]} bands */
function edges(bands) {
  return bands.map((band) => `${band.lowHz / 1000}–${band.lowHz / 1000 + 1} kHz`).join(", ");
}

/** @param {number} hz */
function kilohertz(hz) {
  return `${Number((hz / 1000).toFixed(2))} kHz`;
}

/** @param {number} seconds */
function microseconds(seconds) {
  return seconds < 1e-6 ? "one sample" : `${Math.max(Math.round(seconds * 1e6), 1)} µs`;
}

/** @param {Verdict} verdict @returns {(name: string, said: string) => Check} */
const saying = (verdict) => (name, said) => ({ name, verdict, said });
const pass = saying("pass");
const doubt = saying("doubt");
const fail = saying("fail");

/** What the probe found, in words: a line per check, and what to do about it. */

import { ECHO_RATE_HZ } from "../stages/constants.js";
import { formatLevel, formatNumber } from "../shared/format.js";
import { inSentence, locale, t } from "../shared/words.js";

/**
 * @typedef {"pass" | "doubt" | "fail"} Verdict
 * @typedef {{name: string, verdict: Verdict, said: string}} Check
 * @typedef {import("./probe.js").Measured} Measured
 * @typedef {{label: string, contextRateHz: number, settings: MediaTrackSettings,
 *   outputLatencyS: number}} Ears what the browser says of microphone and sound
 */

const DISTORTIONS = {
  echoCancellation: t("echo cancellation"),
  noiseSuppression: t("noise suppression"),
  autoGainControl: t("automatic gain"),
};
const SAFE_RATE_HZ = ECHO_RATE_HZ;
/** Every real microphone has noise: where more samples than this are nought, somebody cut it off. */
const GATED_SHARE = 0.5;

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
    return { verdict: "fail", said: t("Not yet: {{checks}}. See below what to do, then check again.", { checks: named(failed) }) };
  }
  if (doubted.length > 0) {
    return { verdict: "doubt", said: t("This phone may do it. In doubt: {{checks}}.", { checks: named(doubted) }) };
  }
  return { verdict: "pass", said: t("This phone can do it.") };
}

/** @param {string[]} names @returns {string} one, another and a third */
function listed(names) {
  return names.join(` ${t("and")} `);
}

/** @param {Check[]} checks */
function named(checks) {
  return checks.map(({ name }) => inSentence(name)).join(", ");
}

/** @param {Ears} ears @returns {Check} */
function judgeMicrophone({ label, contextRateHz, settings, outputLatencyS }) {
  const name = t("Microphone");
  const rateHz = settings.sampleRate ?? contextRateHz;
  if (/bluetooth|airpods|buds|hands-?free|headset/i.test(label)) {
    return fail(name, t("“{{label}}” is a headset. Take it off: the phone’s own microphone and loudspeaker are needed.", { label }));
  }
  if (rateHz < SAFE_RATE_HZ) {
    return fail(name, t("It hears only up to {{frequency}}. Switch Bluetooth off and check again.", { frequency: kilohertz(rateHz / 2) }));
  }
  if (outputLatencyS > 0.12) {
    const late = Math.round(outputLatencyS * 1000);
    return doubt(name, t("Sound leaves the phone {{late}} ms late. If a Bluetooth loudspeaker is connected, switch it off.", { late }));
  }
  const rates = { rate: kilohertz(rateHz), other: kilohertz(contextRateHz) };
  if (rateHz === contextRateHz) return pass(name, t("The phone’s own, at {{rate}}.", rates));
  return pass(name, t("The phone’s own, at {{rate}}, sound runs at {{other}}.", rates));
}

/** @param {MediaTrackSettings} settings @returns {Check} */
function judgeProcessing(settings) {
  const name = t("Untouched sound");
  const keys = /** @type {(keyof typeof DISTORTIONS)[]} */ (Object.keys(DISTORTIONS));
  const on = keys.filter((key) => settings[key] === true || typeof settings[key] === "string");
  if (on.length > 0) {
    const which = listed(on.map((key) => DISTORTIONS[key]));
    return fail(name, t("The browser keeps {{which}} on, which wipes out the chirps. Try another browser.", { which }));
  }
  const unknown = keys.filter((key) => settings[key] === undefined);
  if (unknown.length > 0) {
    const which = listed(unknown.map((key) => DISTORTIONS[key]));
    return doubt(name, t("The browser does not say whether {{which}} is off. The levels below tell.", { which }));
  }
  return pass(name, t("Echo cancellation, noise suppression and automatic gain are off."));
}

/** @param {Measured} measured @returns {Check} */
function judgeLevel({ peak, clippedShare, silentShare }) {
  const name = t("Loudness");
  const level = formatLevel(20 * Math.log10(Math.max(peak, 1e-6)));
  if (silentShare > 0.9) {
    return fail(name, t("The microphone gives silence. Allow it in the phone’s settings, and unmute it."));
  }
  if (silentShare > GATED_SHARE) {
    return fail(name, t("Between the chirps the microphone gives pure silence: the browser or another app works on the sound. Try another browser."));
  }
  if (clippedShare > 0.001) {
    return fail(name, t("Far too loud: the microphone is overdriven. Turn the media volume down."));
  }
  if (peak < 0.0005) {
    return fail(name, t("The chirps are hardly heard ({{level}}). Turn the media volume up and uncover loudspeaker and microphone.", { level }));
  }
  if (peak < 0.004) return doubt(name, t("Soft ({{level}}). Turn the media volume up.", { level }));
  return pass(name, t("The chirps are heard at {{level}} of full scale.", { level }));
}

/** @param {Measured} measured @returns {Check} */
function judgeBands({ subbands }) {
  const name = t("15 to 20 kHz");
  const deaf = subbands.filter((band) => band.snrDb < 6);
  const weak = subbands.filter((band) => band.snrDb < 15);
  if (deaf.length > 1) return fail(name, t("Nothing at {{bands}}: this phone or browser cuts the sound off there.", { bands: edges(deaf) }));
  if (weak.length > 0) return doubt(name, t("Weak at {{bands}}. Turn the volume up, or find a quieter place.", { bands: edges(weak) }));
  const least = Math.min(...subbands.map((band) => band.snrDb));
  return pass(name, t("At least {{level}} dB above the noise in every kilohertz.", { level: Math.round(least) }));
}

/** @param {Measured} measured @returns {Check} */
function judgeSteadiness({ heard, frames, jitterS, contrast }) {
  const name = t("Steady timing");
  const share = { heard, frames };
  const off = { time: formatNumber(jitterS * 1000, 1) };
  if (heard < 0.5 * frames) {
    return fail(name, t("Only {{heard}} of {{frames}} chirps were heard. Turn the media volume up, and keep the loudspeaker free.", share));
  }
  if (jitterS > 0.002) return fail(name, t("The chirps come {{time}} ms early or late. Close other apps and check again.", off));
  if (heard < 0.9 * frames || contrast < 12) return doubt(name, t("{{heard}} of {{frames}} chirps were clear. A quieter place helps.", share));
  if (jitterS > 0.0003) return doubt(name, t("The chirps come {{time}} ms early or late.", off));
  const exact = { ...share, time: microseconds(jitterS) };
  return pass(name, t("{{heard}} of {{frames}} chirps came straight from loudspeaker to microphone, to within {{time}}.", exact));
}

/** @param {{rateHz: number, gravityMps2: number}} motion @returns {Check} */
function judgeMotion({ rateHz, gravityMps2 }) {
  const name = t("Motion");
  if (rateHz === 0) return fail(name, t("No motion arrives. Allow motion sensors for this page; a computer has none."));
  const rate = Math.round(rateHz);
  const gravity = formatNumber(gravityMps2, 1);
  if (rateHz < 20) return fail(name, t("Only {{rate}} readings a second; 50 are wanted. Switch the battery saver off.", { rate }));
  if (!(gravityMps2 > 5 && gravityMps2 < 15)) {
    return fail(name, t("Gravity reads {{gravity}} m/s², wanted {{wanted}}. Try another browser.", { gravity, wanted: formatNumber(9.8, 1) }));
  }
  if (rateHz < 45) return doubt(name, t("{{rate}} readings a second; 50 would be better. Switch the battery saver off.", { rate }));
  return pass(name, t("{{rate}} readings a second, gravity at {{gravity}} m/s².", { rate, gravity }));
}

/** @param {number | null} freeBytes @returns {Check} */
function judgeRoom(freeBytes) {
  const name = t("Room on this phone");
  if (freeBytes === null) return pass(name, t("The browser does not say how much is free; ten minutes take 15 MB."));
  const megabytes = Math.round(freeBytes / 1e6);
  if (megabytes < 20) return fail(name, t("{{megabytes}} MB are free; ten minutes take 15 MB. Delete something.", { megabytes }));
  if (megabytes < 100) return doubt(name, t("{{megabytes}} MB are free; ten minutes take 15 MB.", { megabytes }));
  return pass(name, megabytes > 2000
    ? t("{{gigabytes}} GB are free.", { gigabytes: Math.round(megabytes / 1000) })
    : t("{{megabytes}} MB are free.", { megabytes }));
}

/** @param {Measured["subbands"]} bands */
function edges(bands) {
  return bands.map((band) => `${band.lowHz / 1000}–${band.lowHz / 1000 + 1} kHz`).join(", ");
}

/** @param {number} hz */
function kilohertz(hz) {
  return `${(hz / 1000).toLocaleString(locale, { maximumFractionDigits: 2 })} kHz`;
}

/** @param {number} seconds */
function microseconds(seconds) {
  return seconds < 1e-6 ? t("one sample") : `${Math.max(Math.round(seconds * 1e6), 1)} µs`;
}

/** @param {Verdict} verdict @returns {(name: string, said: string) => Check} */
const saying = (verdict) => (name, said) => ({ name, verdict, said });
const pass = saying("pass");
const doubt = saying("doubt");
const fail = saying("fail");

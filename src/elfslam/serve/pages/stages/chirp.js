/** The excitation as elfslam.stages.chirp makes it, sample for sample, from a map's parameters. */

import { ACCEPTED_RATES_HZ, CHIRP_PARAMETERS } from "./constants.js";

/**
 * The group `chirp` of the parameters.
 * @typedef {{kind: string, band_low_hz: number, band_high_hz: number, duration_s: number,
 *   period_s: number, fade_s: number}} ChirpParameters
 */

/**
 * One excitation with a peak of 1.
 * @param {ChirpParameters} parameters
 * @param {number} rateHz one of ACCEPTED_RATES_HZ
 * @returns {Float32Array<ArrayBuffer>}
 */
export function makeChirp(parameters, rateHz) {
  checkRate(rateHz);
  checkKind(parameters.kind);
  const count = Math.round(parameters.duration_s * rateHz);
  const samples = new Float32Array(count);
  for (let n = 0; n < count; n += 1) {
    const edgeS = Math.min(n, count - 1 - n) / rateHz;
    samples[n] = Math.sin(2 * Math.PI * turns(parameters, n / rateHz)) * fade(edgeS, parameters.fade_s);
  }
  return samples;
}

/** @param {number} rateHz */
export function checkRate(rateHz) {
  if (!ACCEPTED_RATES_HZ.includes(rateHz)) {
    throw new RangeError(
      `The sound of this phone runs at ${rateHz} samples/s; wanted 44100 or 48000. ` +
        "Take off Bluetooth and wired headsets, close other apps that use sound, and open the page again.",
    );
  }
}

/** @param {string} kind */
function checkKind(kind) {
  if (kind !== "chirp") {
    throw new RangeError(
      `The server wants the excitation ${kind}; this page plays chirps only. Set it to chirp.`,
    );
  }
}

/** Turns of the logarithmic sweep since its start. @param {ChirpParameters} parameters @param {number} tS */
function turns({ band_low_hz: lowHz, band_high_hz: highHz, duration_s: durationS }, tS) {
  const ratio = highHz / lowHz;
  return ((lowHz * durationS) / Math.log(ratio)) * (ratio ** (tS / durationS) - 1);
}

/** @param {number} edgeS @param {number} fadeS */
function fade(edgeS, fadeS) {
  return fadeS === 0 ? 1 : 0.5 - 0.5 * Math.cos(Math.PI * Math.min(edgeS / fadeS, 1));
}

// The excitation as recording.json tells it.

/**
 * What is played, as recording.json says it.
 * @typedef {{kind: string, band_hz: number[], duration_s: number, period_s: number}} Chirp
 */

/** @type {Chirp} */
export const CHIRP = {
  kind: CHIRP_PARAMETERS.kind, band_hz: [CHIRP_PARAMETERS.band_low_hz, CHIRP_PARAMETERS.band_high_hz],
  duration_s: CHIRP_PARAMETERS.duration_s, period_s: CHIRP_PARAMETERS.period_s,
};

/**
 * One excitation with a peak of 1.
 * @param {Chirp} chirp
 * @param {number} rateHz one of ACCEPTED_RATES_HZ
 * @returns {Float32Array<ArrayBuffer>}
 */
export function excitationOf({ band_hz: [lowHz, highHz], ...told }, rateHz) {
  return makeChirp({ fade_s: CHIRP_PARAMETERS.fade_s, ...told, band_low_hz: lowHz, band_high_hz: highHz }, rateHz);
}

/** @param {Chirp} chirp @param {number} rateHz @returns {number} samples from one chirp to the next */
export function periodSamples(chirp, rateHz) {
  return Math.round(chirp.period_s * rateHz);
}

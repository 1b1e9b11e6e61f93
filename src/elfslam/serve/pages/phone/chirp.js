/** The excitation as recording.json tells it. */

import { makeChirp as chirpOf } from "../stages/chirp.js";

export { ACCEPTED_RATES_HZ } from "../stages/chirp.js";

/**
 * What is played, as recording.json says it.
 * @typedef {{kind: string, band_hz: number[], duration_s: number, period_s: number}} Chirp
 */

/** @type {Chirp} */
export const CHIRP = { kind: "chirp", band_hz: [15000, 20000], duration_s: 0.01, period_s: 0.1 };

/** Raised cosine at both ends, against clicks. */
const FADE_S = 0.001;

/**
 * One excitation with a peak of 1.
 * @param {Chirp} chirp
 * @param {number} rateHz one of ACCEPTED_RATES_HZ
 * @returns {Float32Array<ArrayBuffer>}
 */
export function makeChirp({ band_hz: [lowHz, highHz], ...told }, rateHz) {
  return chirpOf({ fade_s: FADE_S, ...told, band_low_hz: lowHz, band_high_hz: highHz }, rateHz);
}

/** @param {Chirp} chirp @param {number} rateHz @returns {number} samples from one chirp to the next */
export function periodSamples(chirp, rateHz) {
  return Math.round(chirp.period_s * rateHz);
}

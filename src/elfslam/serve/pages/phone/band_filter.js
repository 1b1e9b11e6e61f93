/**
 * The chirp band as plain sound: the same filter as the baseband's, without moving the band,
 *
 *     y[n] = 2 sum_m x[m] h((n - m) / F) cos(2 pi f (n - m) / F).
 *
 * Its taps are the same both ways from the middle, so nothing is delayed and no phase is turned.
 */

import { BASEBAND, HALF_SUPPORT_S, impulseResponse } from "./baseband.js";

/**
 * @typedef {{reach: number, apply: (samples: Float32Array) => Float32Array}} BandFilter reach: samples
 *   that are needed on either side; apply: the band, as many samples shorter at both ends
 */

/** @param {number} rateHz 44100 or 48000 @returns {BandFilter} */
export function makeBandFilter(rateHz) {
  const reach = Math.round(HALF_SUPPORT_S * rateHz);
  const taps = Float64Array.from({ length: reach + 1 }, (_, k) => {
    const turn = (2 * Math.PI * BASEBAND.centreHz * k) / rateHz;
    return impulseResponse(k, rateHz, 1, reach) * Math.cos(turn);
  });
  return { reach, apply: (samples) => filtered(samples, taps, reach) };
}

/** @param {Float32Array} samples @param {Float64Array} taps @param {number} reach */
function filtered(samples, taps, reach) {
  const out = new Float32Array(Math.max(samples.length - 2 * reach, 0));
  for (let n = 0; n < out.length; n += 1) {
    const middle = n + reach;
    let sum = taps[0] * samples[middle];
    for (let k = 1; k <= reach; k += 1) {
      sum += taps[k] * (samples[middle - k] + samples[middle + k]);
    }
    out[n] = sum;
  }
  return out;
}

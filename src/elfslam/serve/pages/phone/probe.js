/** What two seconds of chirps tell about a phone, as numbers; verdicts.js says them in words. */

import { ECHO_PARAMETERS } from "../stages/constants.js";
import { complexZeros, earliest, fourierOf, makeMatchedFilter, median, strongest } from "../stages/matched_filter.js";

/** Samples: as long as a chirp; so many at both ends fade. */
const SPECTRUM = 512;
const FADE = 64;
/** After the direct sound: echoes are over and the next chirp is not due. */
const LULL_S = 0.085;
const SUBBAND_HZ = 1000;
const CLIPPED = 0.98;
/** After the direct sound: its echoes, and what is left when they are over and the next chirp is not heard yet. */
const ECHOES_S = [0.011, 0.035];
const NOISE_S = [0.078, 0.088];

/**
 * @typedef {{first: number, period: number, count: number}} Played samples: when the chirps were due
 * @typedef {{direct: number, delay: number, peak: number, floor: number}} Frame of the envelope, from one chirp to the next
 * @typedef {{lowHz: number, levelDb: number, snrDb: number}} Subband
 * @typedef {{
 *   peak: number, contrast: number, heard: number, frames: number, jitterS: number, latencyS: number,
 *   clippedShare: number, silentShare: number, subbands: Subband[], echoDb: number | null,
 * }} Measured peak: amplitude of the direct sound; contrast: over the median envelope; jitterS: of the
 *   direct arrival, median deviation; latencyS: from playing to hearing; echoDb: echoes over noise in the matched
 *   filter, null where fewer than half of the chirps are heard.
 */

/**
 * @param {Float32Array} samples what was heard
 * @param {number} rateHz
 * @param {Float32Array} chirp
 * @param {Played} played
 * @param {number[]} bandHz
 * @returns {Measured}
 */
export function measure(samples, rateHz, chirp, played, bandHz) {
  const envelope = wholeEnvelope(samples, chirp);
  const frames = framesOf(envelope, played, Math.round(ECHO_PARAMETERS.early_s * rateHz));
  /** @param {Frame} frame */
  const isHeard = (frame) => frame.peak >= ECHO_PARAMETERS.contrast * Math.max(frame.floor, 1e-9);
  // Sound may take longer than a period through the phone: its first chirp is the first that is heard.
  const late = Math.max(frames.findIndex(isHeard), 0);
  const due = frames.slice(late, late + played.count);
  const heard = due.filter(isHeard);
  const delay = median(heard.map((frame) => frame.delay));
  return {
    peak: median(due.map((frame) => frame.peak)),
    contrast: median(due.map((frame) => frame.peak / Math.max(frame.floor, 1e-9))),
    heard: heard.length,
    frames: played.count,
    jitterS: median(heard.map((frame) => Math.abs(frame.delay - delay))) / rateHz,
    latencyS: (late * played.period + delay) / rateHz,
    clippedShare: shareOf(samples, (value) => Math.abs(value) >= CLIPPED),
    silentShare: shareOf(samples, (value) => value === 0),
    subbands: subbandsOf(samples, rateHz, played, late * played.period + delay, bandHz),
    echoDb: 2 * heard.length < played.count ? null : echoLevelDb(envelope, heard, rateHz),
  };
}

/**
 * Level of the echoes over the noise, by the median chirp: a click or a door says nothing of the phone.
 * @param {Float32Array} envelope @param {Frame[]} heard @param {number} rateHz
 */
function echoLevelDb(envelope, heard, rateHz) {
  const whole = heard.filter(({ direct }) => direct + NOISE_S[1] * rateHz < envelope.length);
  /** @param {number[]} stretch */
  const power = ([fromS, untilS]) =>
    median(whole.map(({ direct }) => {
      const part = envelope.subarray(direct + Math.round(fromS * rateHz), direct + Math.round(untilS * rateHz));
      return part.reduce((energy, value) => energy + value * value, 0) / part.length;
    }));
  return decibels(power(ECHOES_S) / Math.max(power(NOISE_S), 1e-20));
}

/**
 * Direct sound in every whole period since the first chirp was played.
 * @param {Float32Array} envelope @param {Played} played @param {number} early @returns {Frame[]}
 */
function framesOf(envelope, { first, period }, early) {
  const count = Math.max(Math.floor((envelope.length - first) / period), 0);
  return Array.from({ length: count }, (_, c) => {
    const start = first + c * period;
    const peak = strongest(envelope, start, start + period);
    const direct = earliest(envelope, peak, early, ECHO_PARAMETERS.early_share);
    return { direct, delay: direct - start, peak: envelope[direct], floor: frameFloor(envelope, start, period) };
  });
}

/** @param {Float32Array} envelope @param {number} start @param {number} period */
function frameFloor(envelope, start, period) {
  return median(envelope.subarray(start, start + period));
}

/** @param {Float32Array} samples @param {Float32Array} chirp */
function wholeEnvelope(samples, chirp) {
  return makeMatchedFilter(chirp, samples.length)(samples);
}

/** @param {Float32Array} samples @param {(value: number) => boolean} test */
function shareOf(samples, test) {
  let count = 0;
  for (const value of samples) count += test(value) ? 1 : 0;
  return count / samples.length;
}

/**
 * Power by frequency while the chirp is heard, over that of the noise: while nothing was played, or at the
 * end of each frame, whichever is less; other phones and echoes are no noise of this one.
 * @param {Float32Array} samples @param {number} rateHz @param {Played} played
 * @param {number} delay samples from playing to hearing @param {number[]} bandHz
 * @returns {Subband[]}
 */
function subbandsOf(samples, rateHz, played, delay, [lowHz, highHz]) {
  const lag = Number.isFinite(delay) ? delay : 0;
  const begin = played.first + lag - (FADE >> 1);
  const starts = Array.from({ length: played.count }, (_, c) => begin + c * played.period);
  const quiet = Array.from(
    { length: Math.max(Math.floor(played.first / SPECTRUM) - 1, 0) },
    (_, k) => k * SPECTRUM,
  );
  const loud = meanPower(samples, starts);
  const noises = [quiet, starts.map((start) => start + Math.round(LULL_S * rateHz))].map((at) =>
    meanPower(samples, at),
  );
  const count = Math.round((highHz - lowHz) / SUBBAND_HZ);
  return Array.from({ length: count }, (_, k) => {
    const edgeHz = lowHz + k * SUBBAND_HZ;
    const signal = bandPower(loud, edgeHz, rateHz);
    const noise = Math.min(...noises.map((power) => bandPower(power, edgeHz, rateHz)));
    return {
      lowHz: edgeHz,
      levelDb: decibels(signal),
      snrDb: decibels(signal / Math.max(noise, 1e-20)),
    };
  });
}

/** By frequency. @param {Float32Array} samples @param {number[]} starts */
function meanPower(samples, starts) {
  const { forward } = fourierOf(SPECTRUM);
  const power = new Float64Array(SPECTRUM / 2);
  const whole = starts.filter((start) => start >= 0 && start + SPECTRUM <= samples.length);
  for (const start of whole) {
    const x = complexZeros(SPECTRUM);
    for (let n = 0; n < SPECTRUM; n += 1) {
      x.re[n] = samples[start + n] * fade(n);
    }
    forward(x);
    for (let k = 0; k < power.length; k += 1) power[k] += x.re[k] ** 2 + x.im[k] ** 2;
  }
  return power.map((value) => value / Math.max(whole.length, 1) / (SPECTRUM / 2) ** 2);
}

/** @param {number} n */
function fade(n) {
  const edge = Math.min(n + 0.5, SPECTRUM - n - 0.5) / FADE;
  return edge < 1 ? Math.sin((Math.PI / 2) * edge) ** 2 : 1;
}

/** @param {Float64Array} power @param {number} edgeHz @param {number} rateHz */
function bandPower(power, edgeHz, rateHz) {
  /** @param {number} hz */
  const bin = (hz) => Math.round((hz * SPECTRUM) / rateHz);
  return power.subarray(bin(edgeHz), bin(edgeHz + SUBBAND_HZ)).reduce((sum, value) => sum + value, 0);
}

/** @param {number} ratio of powers */
function decibels(ratio) {
  return 10 * Math.log10(Math.max(ratio, 1e-20));
}

/** The excitation, sample for sample that of elfslam.line.chirp. */

/**
 * What is played, as recording.json says it.
 * @typedef {{kind: string, band_hz: number[], duration_s: number, period_s: number}} Chirp
 */

/** @type {Chirp} */
export const CHIRP = { kind: "chirp", band_hz: [15000, 20000], duration_s: 0.01, period_s: 0.1 };

/** 10 ms and 100 ms are whole samples at both. */
export const ACCEPTED_RATES_HZ = [44100, 48000];

/** Raised cosine at both ends, against clicks. */
const FADE_S = 0.001;

/**
 * One excitation with a peak of 1.
 * @param {Chirp} chirp
 * @param {number} rateHz one of ACCEPTED_RATES_HZ
 * @returns {Float32Array}
 */
export function makeChirp(chirp, rateHz) {
  checkRate(rateHz);
  checkKind(chirp);
  const count = Math.round(chirp.duration_s * rateHz);
  const samples = new Float32Array(count);
  for (let n = 0; n < count; n += 1) {
    const edgeS = Math.min(n, count - 1 - n) / rateHz;
    samples[n] = Math.sin(2 * Math.PI * turns(chirp, n / rateHz)) * fade(edgeS);
  }
  return samples;
}

/** @param {number} rateHz @returns {number} samples from one chirp to the next */
export function periodSamples(chirp, rateHz) {
  return Math.round(chirp.period_s * rateHz);
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

function checkKind(chirp) {
  if (chirp.kind !== "chirp") {
    throw new RangeError(
      `The server wants the excitation ${chirp.kind}; this page plays chirps only. Set it to chirp.`,
    );
  }
}

/** Turns of the logarithmic sweep since its start. */
function turns({ band_hz: [lowHz, highHz], duration_s: durationS }, tS) {
  const ratio = highHz / lowHz;
  return ((lowHz * durationS) / Math.log(ratio)) * (ratio ** (tS / durationS) - 1);
}

function fade(edgeS) {
  return 0.5 - 0.5 * Math.cos(Math.PI * Math.min(edgeS / FADE_S, 1));
}

/** Plays the chirps: one source per chirp, each put on its sample of the audio clock in advance. */

/** So far ahead chirps are put on the clock: a page in the background wakes up once a second. */
const AHEAD_S = 3;
const EVERY_MS = 250;
/** Too late to be called back. */
const MARGIN_S = 0.05;
/** Of full scale: leaves room for resampling on the way to the loudspeaker. */
const LEVEL = 0.8;

/**
 * @param {AudioContext} context
 * @param {Float32Array} chirp samples at the context's rate
 * @param {number} period samples
 * @param {number} delayS from now to the first chirp
 * @param {number} [count] chirps in all; without it they go on until stopped
 * @param {{jitterS?: number, onPlayed?: (frame: number) => void}} [schedule] each chirp comes up to jitterS
 *   later in its period, by chance; onPlayed: told, ahead of time, the frame at which each begins
 * @returns {{firstFrame: number, stop: () => number}} firstFrame: of the clock, at which the first one
 *   begins; stop: lets those that sound end, and gives the frame at which the last one begins
 */
export function startChirps(context, chirp, period, delayS, count = Infinity, { jitterS = 0, onPlayed = () => {} } = {}) {
  const buffer = context.createBuffer(1, chirp.length, context.sampleRate);
  buffer.copyToChannel(chirp, 0);
  const gain = new GainNode(context, { gain: LEVEL });
  gain.connect(context.destination);
  const firstFrame = Math.ceil((context.currentTime + delayS) * context.sampleRate);
  const due = new Map();
  let next = 0;

  const play = (frame) => {
    const source = new AudioBufferSourceNode(context, { buffer });
    source.connect(gain);
    source.onended = () => due.delete(source);
    source.start(frame / context.sampleRate);
    due.set(source, frame);
    onPlayed(frame);
  };

  const schedule = () => {
    const now = context.currentTime * context.sampleRate;
    const until = now + AHEAD_S * context.sampleRate;
    for (; next < count && firstFrame + next * period < until; next += 1) {
      const frame = firstFrame + next * period + Math.floor(chance() * jitterS * context.sampleRate);
      if (frame > now) play(frame);
    }
  };

  schedule();
  const timer = setInterval(schedule, EVERY_MS);
  const stop = () => {
    clearInterval(timer);
    const now = context.currentTime * context.sampleRate;
    const limit = now + MARGIN_S * context.sampleRate;
    due.forEach((frame, source) => frame > limit && source.stop());
    return firstFrame + Math.max(Math.floor((limit - firstFrame) / period), 0) * period;
  };
  return { firstFrame, stop };
}

/** Nobody can foretell it. @returns {number} in [0, 1) */
function chance() {
  return crypto.getRandomValues(new Uint32Array(1))[0] / 2 ** 32;
}

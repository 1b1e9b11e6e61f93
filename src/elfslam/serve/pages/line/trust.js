/** Whether what is heard can be the room's answer to the phone's own chirps: elfslam.line.trust, live. */

/** Into so many parts of equal length an echo trace falls. */
const PARTS = 4;
/** What the fourth difference makes of the middle of the band. */
const SHARPENED = (2 * Math.sin((Math.PI * 17_500) / 44_100)) ** 4;
/** Chirps whose median says when a direct arrival is due. */
const RECENT = 7;
/** An echo belongs to the frame whose direct sound came then, within so many seconds. */
const SAME_S = 1e-3;

/** By number; 0 is trusted. */
export const REASONS = [
  "",
  "the own chirp is not heard when it was played",
  "sound comes before its chirp",
  "echoes are louder than a room returns them",
  "there is noise in the band of the chirp",
  "the microphone is driven to its limit",
];

/**
 * @typedef {{dueS: number, lateS: number, level: number, before: number, noise: number, clipped: number}} Facts
 *   of one chirp, as echo_facts.js gives them
 * @typedef {{dueS: number, odd: boolean[]}} Judged whether a frame is odd, for each reason but the first
 */

/**
 * A judge of frames as they come. `take` is given the facts of frames and the echoes, each in their order and
 * an echo not after its frame; `reasonAt(endS)` gives the number of the reason to suspect what was heard up
 * to then, 0 where there is none, more strictly behind a suspect one; `REASONS` has it in words.
 * @param {Record<string, number>} parameters the group "trust"
 * @returns {{take: (facts: Facts[], echoes: {tS: number, samples: Float32Array}[]) => void,
 *   reasonAt: (endS: number) => number}}
 */
export function makeTrust(parameters) {
  const bounds = ["loud_first", "loud_second", "loud_third", "loud_last"].map((name) => parameters[name]);
  let loud = [];
  let recent = [];
  /** @type {Judged[]} */
  let frames = [];
  let last = 0;

  const take = (facts, echoes) => {
    loud.push(...echoes.map(({ tS, samples }) => ({ tS, rms: loudnessOf(samples) })));
    for (const each of facts) frames.push({ dueS: each.dueS, odd: oddIn(each) });
  };

  const oddIn = ({ dueS, lateS, level, before, noise, clipped }) => {
    const off = offTime(lateS);
    const floor = Math.max(level, 1e-12);
    const rms = loudnessAt(dueS + (Number.isNaN(lateS) ? 0 : lateS));
    return [
      off > parameters.off_time_s,
      before > parameters.before,
      rms.some((value, part) => value / floor > bounds[part]),
      noise / floor > parameters.noise,
      clipped > parameters.clipped,
    ];
  };

  const offTime = (lateS) => {
    if (Number.isNaN(lateS)) return Infinity;
    const off = recent.length > 0 ? Math.abs(lateS - median(recent)) : 0;
    recent = [...recent, lateS].slice(-RECENT);
    return off;
  };

  const loudnessAt = (arrivedS) => {
    loud = loud.filter(({ tS }) => tS >= arrivedS - SAME_S);
    return loud.length > 0 && loud[0].tS <= arrivedS + SAME_S ? loud[0].rms : [0, 0, 0, 0];
  };

  const reasonAt = (endS) => {
    const seen = frames.filter(({ dueS }) => dueS >= endS - parameters.memory_s && dueS < endS);
    frames = frames.filter(({ dueS }) => dueS >= endS - parameters.memory_s);
    last = seen.length < parameters.fewest_frames ? 0 : reasonIn(seen);
    return last;
  };

  const reasonIn = (seen) => {
    const limit = last > 0 ? parameters.calm_share : parameters.odd_share;
    const share = (reason) => seen.filter(({ odd }) => odd[reason - 1]).length / seen.length;
    return Math.max(REASONS.findIndex((_, reason) => reason > 0 && share(reason) >= limit), 0);
  };
  return { take, reasonAt };
}

/**
 * Root mean square of each part of an echo trace, of its fourth differences: they leave little of what is
 * below the chirp's band.
 * @param {Float32Array} samples (2352) @returns {number[]} (4)
 */
export function loudnessOf(samples) {
  const size = samples.length / PARTS;
  const squares = new Array(PARTS).fill(0);
  for (let k = 4; k < samples.length; k += 1) {
    const sharp = samples[k] - 4 * samples[k - 1] + 6 * samples[k - 2] - 4 * samples[k - 3] + samples[k - 4];
    squares[Math.floor(k / size)] += sharp * sharp;
  }
  return squares.map((sum) => Math.sqrt(sum / size) / SHARPENED);
}

function median(values) {
  const sorted = Float64Array.from(values).sort();
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : (sorted[half - 1] + sorted[half]) / 2;
}

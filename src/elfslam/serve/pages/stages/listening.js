/**
 * Slot by slot: when other phones chirped, by the rules of elfslam.stages.medium_access. Before an own direct
 * arrival and once its echoes are over nothing of ours is heard: what is loud there is somebody else's.
 */

/** Samples of the envelope of which the largest stands for all, at 44.1 kHz. */
export const BIN = 16;
const ECHO_RATE_HZ = 44100;
/** Bins before a direct arrival in which the matched filter hears it already. */
export const GUARD = 12;
/** Bins behind a direct arrival in which nothing else is heard. */
export const DIRECT = 6;
/** Bins behind a direct arrival after which its echoes are over. */
export const LULL = 193;
/** Bins in which another's chirp echoes. */
const SAME = 165;
const LOUDEST_ECHO = 2;
const FADES = 0.05;
const SLACK = 88;
/** What is heard later than that behind the beginning of a slot belongs to the next. */
const LATE = Math.round(0.0625 * ECHO_RATE_HZ);
const NOISE = 6;
const STRETCHES = 16;
/** A stretch more silent than that beside the own direct sound was lost, and tells of no noise. */
const LOST = 1e-6;
const REMEMBERED = 8;

/**
 * What was heard so far; samples are those of a line at 44.1 kHz.
 * @typedef {{direct: number, until: number | null, limit: number, others: Beginning[],
 *   noises: number[]}} Listening
 * @typedef {Listening & {until: number}} Begun
 * @typedef {{start: number, end: number, due: number | null, following: number | null}} Slot
 * @typedef {[number, number]} Beginning bin or sample of another's chirp, and its level
 */

/** @type {Listening} */
export const NOTHING_HEARD = { direct: 0, until: null, limit: 0, others: [], noises: [] };

/**
 * Samples at which others' chirps arrived in a slot, where the own one leaves silence.
 * @param {Listening} listening
 * @param {Float32Array} envelope of the matched filter, beginning at sample `first`
 * @param {number} first @param {Slot} slot @param {import("./medium_access.js").MediumAccessParameters} parameters
 * @returns {{others: number[], listening: Listening}}
 */
export function hearSlot(listening, envelope, first, slot, parameters) {
  let now = /** @type {Begun} */ (listening.until === null ? { ...listening, until: slot.start } : listening);
  if (slot.due !== null) {
    const arrival = arrivalIn(envelope, slot.due - first) + first;
    now = { ...now, direct: envelope[arrival - first] };
    now = inSilence(now, envelope, first, arrival - GUARD * BIN, parameters);
    now = { ...now, until: arrival + LULL * BIN };
  }
  const end = slot.following === null ? slot.end : slot.following - SLACK - GUARD * BIN;
  now = inSilence(now, envelope, first, Math.min(end, slot.end), parameters);
  const limit = slot.start + LATE;
  const here = now.others.map(([sample]) => sample).filter((each) => listening.limit <= each && each < limit);
  return { others: here, listening: { ...now, limit } };
}

/**
 * Listens up to a sample; nothing of ours is heard until then.
 * @param {Begun} now @param {Float32Array} envelope @param {number} first @param {number} end
 * @param {import("./medium_access.js").MediumAccessParameters} parameters @returns {Begun}
 */
function inSilence(now, envelope, first, end, parameters) {
  const begin = now.until;
  const bins = pooled(envelope, begin - first, Math.floor((end - begin) / BIN));
  if (bins.length === 0) return now;
  const level = middle(bins);
  const noises = level > LOST * now.direct ? [...now.noises, level].slice(-STRETCHES) : now.noises;
  const least = Math.max(parameters.share * now.direct, noises.length > 0 ? NOISE * Math.min(...noises) : 0);
  /** @type {Beginning[]} */
  const before = now.others.map(([sample, level]) => [Math.floor((sample - begin) / BIN), level]);
  /** @type {Beginning[]} */
  const found = beginnings(bins, least, before).map(([k, level]) => [begin + k * BIN, level]);
  const others = [...now.others, ...found].slice(-REMEMBERED);
  return { ...now, until: begin + bins.length * BIN, others, noises };
}

/**
 * The largest of every 16 samples from `first` on; zero beyond the ends.
 * @param {Float32Array} envelope @param {number} first @param {number} count of bins
 */
export function pooled(envelope, first, count) {
  const bins = new Float32Array(Math.max(count, 0));
  for (let k = 0; k < bins.length; k += 1) {
    for (let n = first + k * BIN; n < first + (k + 1) * BIN; n += 1) {
      if (n >= 0 && n < envelope.length && envelope[n] > bins[k]) bins[k] = envelope[n];
    }
  }
  return bins;
}

/**
 * Where others' chirps begin: bin and level of each. What their echoes may be is none.
 * @param {Float32Array} bins @param {number} least @param {Beginning[]} before
 */
function beginnings(bins, least, before) {
  const found = [...before];
  const isNew = () => found.length > before.length;
  bins.forEach((level, k) => {
    if (!(level > least)) return;
    const last = /** @type {Beginning} */ (found.at(-1)); // where one is new
    if (isNew() && k - last[0] <= DIRECT) {
      if (level > last[1]) found[found.length - 1] = [k, level];
    } else if (level > Math.max(0, ...found.map((chirp) => echoAt(chirp, k)))) {
      found.push([k, level]);
    }
  });
  return found.slice(before.length);
}

/** @param {Beginning} chirp @param {number} k */
function echoAt([begin, level], k) {
  return k - begin < SAME ? LOUDEST_ECHO * level * FADES ** ((k - begin) / SAME) : 0;
}

/** @param {Float32Array} envelope @param {number} due */
function arrivalIn(envelope, due) {
  let best = Math.max(due - SLACK, 0);
  for (let k = best; k < Math.min(due + SLACK + 1, envelope.length); k += 1) {
    if (envelope[k] > envelope[best]) best = k;
  }
  return best;
}

/** @param {Float32Array} values */
function middle(values) {
  const sorted = Float32Array.from(values).sort();
  const half = sorted.length >> 1;
  return sorted.length % 2 ? sorted[half] : Math.fround((sorted[half - 1] + sorted[half]) / 2);
}

/** The microphone's stream as one line of samples, of which the beginning is forgotten as it goes. */

/**
 * @typedef {{
 *   append: (first: number, samples: Float32Array) => number,
 *   slice: (from: number, to: number) => Float32Array,
 *   forget: (before: number) => void,
 *   end: () => number,
 * }} Stream append: adds samples that begin at sample `first`, silence where some are missing before
 *   them, and gives how many were missing; slice: copies [from, to), zeros where nothing is known.
 */

/**
 * @param {number} capacity samples that are remembered at least
 * @param {number} [origin] the sample at which it begins
 * @returns {Stream}
 */
export function makeStream(capacity, origin = 0) {
  let line = new Float32Array(2 * capacity);
  let start = origin;
  let end = origin;

  /** @param {number} count */
  const makeRoom = (count) => {
    if (end - start + count <= line.length) return;
    const wanted = Math.max(line.length, 2 * (end - start + count));
    const longer = new Float32Array(wanted);
    longer.set(line.subarray(0, end - start));
    line = longer;
  };

  /** @type {Stream["append"]} */
  const append = (first, samples) => {
    const missing = Math.max(first - end, 0);
    const late = Math.max(end - first, 0);
    makeRoom(missing + samples.length);
    line.fill(0, end - start, end - start + missing);
    end += missing;
    line.set(samples.subarray(late), end - start);
    end += Math.max(samples.length - late, 0);
    return missing;
  };

  /** @type {Stream["slice"]} */
  const slice = (from, to) => {
    const out = new Float32Array(to - from);
    const known = Math.max(from, start);
    if (known < Math.min(to, end)) {
      out.set(line.subarray(known - start, Math.min(to, end) - start), known - from);
    }
    return out;
  };

  /** @type {Stream["forget"]} */
  const forget = (before) => {
    const count = Math.min(Math.max(before - start, 0), end - start);
    if (count < capacity) return;
    line.copyWithin(0, count, end - start);
    start += count;
  };

  return { append, slice, forget, end: () => end };
}

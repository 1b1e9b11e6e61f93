/** What all echoes of a walk have in common is the phone's and tells no place: as elfslam.stages.feature takes it away. */

import { ELF_SIZE } from "./floor_map.js";

/** With so many echoes of nothing a walk begins. */
const UNHEARD_ECHOES = 30;
/** An echo is compared with the one so many before it, half a second. */
const STILL_ECHOES = 5;
/** Above this cosine the phone stands. */
const STILL = 0.6;
/** What an echo then counts: the mean would fill with that place. */
const STILL_WEIGHT = 0.05;

/**
 * Takes the unit vectors (n, 128) of a walk as they come and gives each less the mean of those so far, made unit again.
 * @returns {(vectors: Float32Array) => Float32Array}
 */
export function makeCentring() {
  const sum = new Float64Array(ELF_SIZE);
  let counted = UNHEARD_ECHOES;
  /** @type {Float32Array[]} */
  let lately = [];

  /** @param {Float32Array} vector */
  const count = (vector) => {
    const isStill = lately.length === STILL_ECHOES && cosine(vector, lately[0]) > STILL;
    lately = [...lately, vector.slice()].slice(-STILL_ECHOES);
    const weight = isStill ? STILL_WEIGHT : 1;
    counted += weight;
    vector.forEach((value, d) => (sum[d] += weight * value));
  };

  /** @param {Float32Array} vector */
  const own = (vector) => {
    count(vector);
    const rest = Float64Array.from(vector, (value, d) => value - sum[d] / counted);
    const length = Math.max(Math.hypot(...rest), 1e-12);
    return rest.map((value) => value / length);
  };

  return (vectors) => {
    const centred = new Float32Array(vectors.length);
    for (let at = 0; at < vectors.length; at += ELF_SIZE) centred.set(own(vectors.subarray(at, at + ELF_SIZE)), at);
    return centred;
  };
}

/** @param {Float32Array} a @param {Float32Array} b unit vectors */
function cosine(a, b) {
  return a.reduce((total, value, d) => total + value * b[d], 0);
}

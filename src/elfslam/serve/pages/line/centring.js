/** What all echoes of a walk have in common is the phone's and tells no place: as elfslam.line.feature takes it away. */

import { ELF_SIZE } from "./floor_map.js";

/** With so many echoes of nothing a walk begins. */
export const UNHEARD_ECHOES = 30;

/**
 * Takes the unit vectors (n, 128) of a walk as they come and gives each less the mean of those so far, made unit again.
 * @returns {(vectors: Float32Array) => Float32Array}
 */
export function makeCentring() {
  const sum = new Float64Array(ELF_SIZE);
  let counted = UNHEARD_ECHOES;

  /** @param {Float32Array} vector */
  const own = (vector) => {
    counted += 1;
    vector.forEach((value, d) => (sum[d] += value));
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

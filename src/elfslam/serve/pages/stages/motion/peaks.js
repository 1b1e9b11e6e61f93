/** Peaks of a signal, by height over what surrounds them and by distance, as scipy.signal.find_peaks. */

/**
 * @param {Float64Array} values
 * @param {number} distance least number of samples between peaks, the higher ones first
 * @param {number} least prominence
 * @returns {{peaks: number[], prominences: number[]}} in order of time
 */
export function findPeaks(values, distance, least) {
  const apart = farApart(localMaxima(values), values, Math.ceil(distance));
  const found = apart.map((peak) => ({ peak, prominence: prominenceOf(values, peak) }));
  const kept = found.filter(({ prominence }) => prominence >= least);
  return { peaks: kept.map(({ peak }) => peak), prominences: kept.map(({ prominence }) => prominence) };
}

/** The middle of each stretch of equal values that is higher than what lies beside it. @param {Float64Array} values */
function localMaxima(values) {
  const maxima = [];
  const last = values.length - 1;
  for (let k = 1; k < last; k += 1) {
    if (values[k - 1] >= values[k]) continue;
    let end = k + 1;
    while (end < last && values[end] === values[k]) end += 1;
    if (values[end] < values[k]) {
      maxima.push((k + end - 1) >> 1);
      k = end;
    }
  }
  return maxima;
}

/** @param {number[]} peaks @param {Float64Array} values @param {number} distance */
function farApart(peaks, values, distance) {
  const isKept = new Array(peaks.length).fill(true);
  const byHeight = peaks.map((_, k) => k).sort((a, b) => values[peaks[b]] - values[peaks[a]]);
  for (const k of byHeight) {
    if (!isKept[k]) continue;
    for (let j = k - 1; j >= 0 && peaks[k] - peaks[j] < distance; j -= 1) isKept[j] = false;
    for (let j = k + 1; j < peaks.length && peaks[j] - peaks[k] < distance; j += 1) isKept[j] = false;
  }
  return peaks.filter((_, k) => isKept[k]);
}

/**
 * How far one must come down, on the higher side, before it goes higher than the peak.
 * @param {Float64Array} values @param {number} peak
 */
function prominenceOf(values, peak) {
  const lowest = (/** @type {number} */ step) => {
    let low = values[peak];
    for (let k = peak; k >= 0 && k < values.length && values[k] <= values[peak]; k += step) {
      if (values[k] < low) low = values[k];
    }
    return low;
  };
  return values[peak] - Math.max(lowest(-1), lowest(1));
}

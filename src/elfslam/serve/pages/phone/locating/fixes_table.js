/** Fixes as a table, the same that `elfslam locate` writes. Pure. */

const HEADER = "t_s,x_m,y_m,heading_rad,sigma_m,status\n";

/** @param {import("./words.js").Fix[]} fixes @param {number} zeroS of their clock, which is 0 in the table */
export function tableOfFixes(fixes, zeroS) {
  return HEADER + fixes.map((fix) => rowOf(fix, zeroS)).join("");
}

/** @param {import("./words.js").Fix} fix @param {number} zeroS */
function rowOf({ tS, xyM, headingRad, covarianceM2, status }, zeroS) {
  const sigma = covarianceM2 ? Math.sqrt((covarianceM2[0] + covarianceM2[2]) / 2) : NaN;
  const numbers = [...(xyM ?? [NaN, NaN]), headingRad, sigma];
  const cells = numbers.map((value) => (Number.isFinite(value) ? value.toFixed(6) : ""));
  return `${[(tS - zeroS).toFixed(6), ...cells, status].join()}\n`;
}

// One-shot localization in the page against elfslam.stages.locate, on the vectors of test_line_modules.py.

import assert from "node:assert/strict";
import { readdirSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { checkedMap } from "../../../../src/elfslam/serve/pages/stages/floor_map.js";
import { fixOf, meanOf, similarity } from "../../../../src/elfslam/serve/pages/stages/locate.js";
import { assertNear, floats, floorMapIn, told } from "./vectors.mjs";

const SCENES = readdirSync(process.env.ELFSLAM_VECTORS).map((name) => join(process.env.ELFSLAM_VECTORS, name));

function assertSameFixes(got, wanted) {
  assert.deepEqual(got.map(({ status }) => status), wanted.map(({ status }) => status));
  wanted.forEach((fix, k) => {
    assertNear([got[k].tS], [fix.tS], 1e-9, `time of fix ${k}`);
    assert.equal(got[k].xyM === null, fix.xyM === null);
    assert.equal(Number.isNaN(got[k].score), fix.score === null);
    if (fix.score !== null) assertNear([got[k].score], [fix.score], 1e-5, `score ${k}`);
    if (fix.xyM === null) return;
    assertNear(got[k].xyM, fix.xyM, 1e-4, `position ${k}`);
    assertNear([got[k].headingRad], [fix.headingRad], 1e-4, `heading ${k}`);
    assertNear(got[k].covarianceM2, fix.covarianceM2, 1e-4, `covariance ${k}`);
  });
}

/** Mean features between consecutive times; null where echoes are fewer than `fewest`. */
function meansBetween(tS, vectors, edgesS, fewest) {
  const rows = Array.from(edgesS, (edgeS) => Array.from(tS).filter((whenS) => whenS < edgeS).length);
  return rows.slice(1).map((to, k) => (to - rows[k] >= Math.max(fewest, 1) ? meanOf(vectors, rows[k], to) : null));
}

/** A fix for every window of sound, one after the other, as elfslam locate gives them. */
function locateOneShot(tS, vectors, floorMap) {
  const { locate } = floorMap.parameters;
  const count = Math.trunc((tS[tS.length - 1] - tS[0]) / locate.window_s) + 1;
  const edgesS = Float64Array.from({ length: count + 1 }, (_, k) => tS[0] + locate.window_s * k);
  return meansBetween(tS, vectors, edgesS, locate.fewest_echoes).map((mean, k) => {
    return fixOf(mean && similarity(mean, floorMap), floorMap, locate, (edgesS[k] + edgesS[k + 1]) / 2);
  });
}

for (const folder of SCENES) {
  const stages = told(folder, "stages.json");
  const floorMap = checkedMap(floorMapIn(folder));
  const heard = floats(folder, "heard");
  const means = floats(folder, "means");
  const scores = floats(folder, "scores");
  const meanAt = (k) => means.subarray(128 * k, 128 * (k + 1));
  const spots = floorMap.headingRad.length;

  test(`means at ${stages.rate_hz} Hz are Python's`, () => {
    const fewest = floorMap.parameters.locate.fewest_echoes;
    const got = meansBetween(stages.t_s, heard, stages.edges_s, fewest);
    assert.equal(got.length, means.length / 128);
    got.forEach((mean, k) => {
      assert.equal(mean === null, Number.isNaN(meanAt(k)[0]));
      if (mean) assertNear(mean, meanAt(k), 1e-6, `mean ${k}`);
    });
  });

  test(`scores at ${stages.rate_hz} Hz are Python's`, () => {
    for (let k = 0; k < means.length / 128; k += 1) {
      if (Number.isNaN(meanAt(k)[0])) continue;
      assertNear(similarity(meanAt(k), floorMap), scores.subarray(spots * k, spots * (k + 1)), 1e-5, `scores ${k}`);
    }
  });

  test(`fixes at ${stages.rate_hz} Hz are Python's`, () => {
    const statuses = new Set(stages.fixes.map(({ status }) => status));
    assert.ok(statuses.has("OK") && statuses.has("UNKNOWN_PLACE") && statuses.has("NO_ECHO"), [...statuses].join());
    assertSameFixes(locateOneShot(stages.t_s, heard, floorMap), stages.fixes);
  });

  test(`ambiguous fixes at ${stages.rate_hz} Hz are Python's`, () => {
    const parameters = { ...floorMap.parameters, locate: stages.hard_to_tell };
    assert.ok(stages.ambiguous.some(({ status }) => status === "AMBIGUOUS"));
    assertSameFixes(locateOneShot(stages.t_s, heard, { ...floorMap, parameters }), stages.ambiguous);
  });
}

test("too little sound is no echo", () => {
  const fix = fixOf(null, floorMapIn(SCENES[0]), floorMapIn(SCENES[0]).parameters.locate, 3);
  assert.deepEqual(fix, { tS: 3, xyM: null, headingRad: NaN, covarianceM2: null, score: NaN, status: "NO_ECHO" });
});

test("a map whose parts do not belong together is refused", () => {
  const floorMap = floorMapIn(SCENES[0]);
  assert.throws(() => checkedMap({ ...floorMap, vectors: floorMap.vectors.subarray(1) }), /128 numbers of vectors/);
  assert.throws(() => checkedMap({ ...floorMap, headingRad: new Float32Array(0) }), /no spots/);
});

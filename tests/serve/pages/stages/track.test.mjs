// The tracker in the page equals the line's, step by step, when it draws the same.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { makeTracker } from "../../../../src/elfslam/serve/pages/stages/track.js";
import { densest, makeRandom } from "../../../../src/elfslam/serve/pages/stages/particles.js";
import { nearestIn, treeOf } from "../../../../src/elfslam/serve/pages/stages/nearest.js";

const { walks, nearest } = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS));
const WITHIN = 1e-6;

function replayed(draws) {
  let used = 0;
  const next = () => {
    assert.ok(used < draws.length, "more draws than the line's");
    used += 1;
    return draws[used - 1];
  };
  return { uniform: next, normal: next, used: () => used };
}

function mapOf({ xyM, headingRad, covarianceM2 }) {
  return {
    xyM: Float32Array.from(xyM),
    headingRad: Float32Array.from(headingRad),
    covarianceM2: Float32Array.from(covarianceM2),
  };
}

function follow(walk, random) {
  const tracker = makeTracker(mapOf(walk.map), walk.parameters, random);
  return walk.steps.map(({ move, sigma, scores, suspect }) =>
    tracker.step(move, sigma, scores && Float32Array.from(scores), suspect));
}

walks.forEach((walk, number) => {
  test(`walk ${number}: each fix is the line's`, () => {
    const random = replayed(walk.draws);
    follow(walk, random).forEach((fix, k) => {
      const { told, status } = walk.steps[k];
      assert.equal(fix.status, status, `step ${k}`);
      const got = [...(fix.xyM ?? [NaN, NaN]), fix.headingRad, ...(fix.covarianceM2 ?? [NaN, NaN, NaN]), fix.score];
      told.forEach((value, column) => {
        if (value === null) assert.ok(Number.isNaN(got[column]), `step ${k}, column ${column}: ${got[column]}`);
        else assert.ok(Math.abs(got[column] - value) < WITHIN, `step ${k}, column ${column}: ${got[column]}, wanted ${value}`);
      });
    });
    assert.equal(random.used(), walk.draws.length);
  });
});

test("a tracker with a seed of its own gives the same fixes again, and finds the walker", () => {
  const [once, again, other] = [1, 1, 2].map((seed) => follow(walks[0], makeRandom(seed)));
  assert.deepEqual(once, again);
  assert.notDeepEqual(once, other);
  const { map, steps } = walks[0];
  const away = once.flatMap(({ xyM }, k) => {
    if (!xyM || !steps[k].scores) return [];
    const loudest = steps[k].scores.indexOf(Math.max(...steps[k].scores));
    const [x, y] = map.xyM.slice(2 * loudest, 2 * loudest + 2);
    return [Math.min(Math.hypot(xyM[0] - x, xyM[1] - y), Math.hypot(xyM[0] + x, xyM[1] + y))];
  });
  assert.ok(away.length > 15, `${away.length} fixes`);
  assert.ok(away.sort((a, b) => a - b)[away.length >> 1] < 0.7, `median ${away[away.length >> 1]}`);
});

test("the nearest points are scipy's", () => {
  const ask = nearestIn(treeOf(Float64Array.from(nearest.points)), 5);
  nearest.asked.forEach((point, k) => {
    const all = ask(...point, Infinity);
    assert.deepEqual([...all.indices], nearest.rows[k]);
    all.squares.forEach((square, n) => assert.ok(Math.abs(square - nearest.squares[k][n]) < 1e-9));
    const near = ask(...point, nearest.within);
    assert.deepEqual([...near.indices.subarray(0, near.found)], nearest.rows_within[k]);
  });
});

test("of places that weigh the same the first in x is taken, then in y", () => {
  const at = (...places) => densest({ poses: Float64Array.from(places.flat()), weight: new Float64Array(places.length).fill(1 / places.length) }, 1);
  assert.deepEqual(at([9.5, -9.5, 0], [-9.5, 9.5, 0]), [-9.5, 9.5]);
  assert.deepEqual(at([9.5, 9.5, 0], [9.5, -9.5, 0]), [9.5, -9.5]);
  assert.deepEqual(at([-9.5, 9.5, 0], [9.5, -9.5, 0], [9.5, -9.5, 0]), [9.5, -9.5]);
});

test("few points and equal points are found too", () => {
  const few = nearestIn(treeOf(Float64Array.from([0, 0, 0, 0, 1, 0, 0, 0])), 2)(0.9, 0, 0, 0, Infinity);
  assert.deepEqual([...few.indices], [1, 0]);
  const equal = nearestIn(treeOf(new Float64Array(400)), 4)(1, 0, 0, 0, Infinity);
  assert.equal(equal.found, 4);
  assert.equal(new Set(equal.indices).size, 4);
});

test("draws are spread as they should be", () => {
  const random = makeRandom(7);
  const count = 200_000;
  const uniform = Array.from({ length: count }, random.uniform);
  const normal = Array.from({ length: count }, random.normal);
  const mean = (values, power) => values.reduce((sum, value) => sum + value ** power, 0) / count;
  assert.ok(uniform.every((value) => value >= 0 && value < 1));
  assert.ok(Math.abs(mean(uniform, 1) - 1 / 2) < 0.003 && Math.abs(mean(uniform, 2) - 1 / 3) < 0.003);
  [0, 1, 0, 3].forEach((wanted, k) => assert.ok(Math.abs(mean(normal, k + 1) - wanted) < 0.06, `moment ${k + 1}`));
  assert.notEqual(makeRandom(1).uniform(), makeRandom(2).uniform());
});

// The graph and the closures of a walk that grows equal those that the line makes of the whole walk.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import {
  amidNoise, makeAttenuation, makeClosureSearch, makeGrowingGraph, solved, unrivalled,
} from "../../../../src/elfslam/serve/pages/phone/growing/sketch.js";
import { assertNear } from "./vectors.mjs";

const { walks, means, parameters, candidates, attenuated } = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS));
const FOUND_SHARE = 0.7;
/** Of a chi-square of three degrees of freedom, in one of 100 cases. */
const GATE = 11.345;

function grown({ moves, sigma, closures }, gate = Infinity) {
  const graph = makeGrowingGraph({ gate });
  const waiting = [...closures];
  moves.forEach((moveM, k) => {
    graph.step({ moveM, sigma });
    while (waiting.length > 0 && waiting[0].j === k + 1) graph.offer(waiting.shift());
  });
  return graph;
}

function meanError(poses, wanted) {
  let sum = 0;
  for (let k = 0; k < poses.length; k += 3) sum += Math.hypot(poses[k] - wanted[k], poses[k + 1] - wanted[k + 1]);
  return (3 * sum) / poses.length;
}

walks.forEach((walk, number) => {
  test(`walk ${number}: footsteps lie where the line's graph puts them`, () => {
    const poses = grown(walk).poses();
    assert.ok(meanError(poses, walk.solved) < 0.02, "a map on a phone needs no more");
    assert.ok(meanError(poses, walk.true) < 0.8 * meanError(walk.reckoned, walk.true), "loops straighten the walk");
  });

  test(`walk ${number}: without closures dead reckoning stays as it is`, () => {
    assertNear(grown({ ...walk, closures: [] }).poses(), walk.reckoned, 1e-9, "pose");
  });
});

test("a closure that dead reckoning and the others exclude is not believed", () => {
  const [walk] = walks;
  const graph = grown(walk, GATE);
  const before = graph.poses();
  const { iFromJ, sigma } = walk.closures[0];
  assert.equal(graph.closures().length, walk.closures.length);
  assert.equal(graph.offer({ i: 5, j: 65, iFromJ, sigma }), false);
  assert.deepEqual(graph.poses(), before);
  assert.equal(graph.offer({ i: 6, j: 46, iFromJ: [0, 0, 0], sigma }), true);
});

test("what is solved for fulfils its equations", () => {
  const matrix = [[4, 0, 0], [1, 5, 0], [-2, 1, 6]].map((row) => Float64Array.from(row));
  const found = solved(matrix, [1, 2, 3]);
  const whole = [[4, 1, -2], [1, 5, 1], [-2, 1, 6]];
  assertNear(whole.map((row) => row.reduce((sum, each, k) => sum + each * found[k], 0)), [1, 2, 3], 1e-12, "right side");
});

test("what sounds alike is found as the line finds it, again and back", () => {
  const search = makeClosureSearch();
  const found = means.map((mean) => search(Float32Array.from(mean), parameters)).flat();
  const key = ({ i, j, isBack }) => `${i} ${j} ${isBack}`;
  const wanted = new Map(candidates.map((each) => [key(each), each]));
  const whole = found.filter((each) => each.j < means.length - 2 * parameters.half_sequence);
  for (const each of whole) assert.ok(Math.abs(wanted.get(key(each))?.score - each.score) < 1e-5, key(each));
  for (const isBack of [false, true]) {
    const rows = (all) => new Set(all.filter((each) => each.isBack === isBack).map(({ j }) => j)).size;
    assert.ok(rows(whole) > 20, `found ${rows(whole)}`);
    assert.ok(rows(found) >= FOUND_SHARE * rows(candidates), `${rows(found)} of ${rows(candidates)}`);
  }
});

test("of two places that sound alike neither is offered, and of one place the best", () => {
  const poses = new Float64Array(300).map((_, k) => (k % 3 === 0 ? 0.7 * Math.floor(k / 3) : 0));
  const one = { i: 20, j: 60, score: 0.7, ahead: 0.5, isBack: false };
  const beside = { ...one, i: 21, score: 0.69 };
  const rival = { ...one, i: 40, score: 0.68 };
  assert.equal(unrivalled([], poses, parameters), null);
  assert.equal(unrivalled([one, rival], poses, parameters), null);
  const closure = unrivalled([one, beside, { ...rival, score: 0.5 }], poses, parameters);
  assertNear(closure.iFromJ, [0.35, 0, 0], 1e-9, "ahead");
  assert.deepEqual([closure.i, closure.j], [20, 60]);
  assertNear(unrivalled([{ ...one, isBack: true }], poses, parameters).iFromJ, [0.35, 0, Math.PI], 1e-9, "back");
});

test("what noise takes of mean features is told by their successive echoes as the line tells it", () => {
  for (const { echoDb, alike, attenuation } of attenuated) {
    const told = makeAttenuation(echoDb);
    assertNear([told(alike.slice(0, 30)) && told(alike.slice(30))], [attenuation], 1e-6, echoDb);
  }
  const kinds = new Set(attenuated.map(({ attenuation }) => attenuation.toFixed(3)));
  assert.ok(kinds.size > 4, `${[...kinds]}`);
  assert.equal(makeAttenuation(null)([0.1, 0.1]), 1);
  assert.equal(makeAttenuation(3)([]), 1);
});

test("amid noise less similarity is wanted, by what noise takes of both", () => {
  assert.deepEqual(amidNoise(parameters, 1), parameters);
  const { threshold, rival_margin: rival } = amidNoise(parameters, 0.7);
  assertNear([threshold, rival], [0.49 * parameters.threshold, 0.49 * parameters.rival_margin], 1e-9, "left");
});

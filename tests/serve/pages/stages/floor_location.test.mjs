// The vote on floors in the page against elfslam.slam.floor_location, on the vectors of test_growing_modules.py.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { FLOOR_VOTE } from "../../../../src/elfslam/serve/pages/stages/constants.js";
import { elected, makeFloors } from "../../../../src/elfslam/serve/pages/stages/floor_location.js";

const scenes = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS, "utf8"));
const SIZE = 128;
const EVERY_S = 0.5;

const votesOf = ({ t_s, scores }) => t_s.map((tS, k) => ({ tS, best: scores[k].map((score) => score ?? NaN) }));

scenes.forEach((scene, number) => {
  test(`votes on ${scene.levels.length} floors are Python's (${number})`, () => {
    const votes = votesOf(scene);
    votes.forEach(({ tS }, k) => {
      const { floor, isSure } = elected(votes, tS, scene.parameters);
      assert.deepEqual([scene.levels[floor], isSure], [scene.level[k], scene.sure[k]], `at ${tS}`);
    });
  });
});

/** A direction of features, somewhat towards another one. */
const towards = (axis, other = axis, share = 0) => Float32Array.from({ length: SIZE }, (_, d) => (d === axis ? 1 : 0) + (d === other ? share : 0));
/** A floor with one spot, which sounds like an axis. */
const floorOf = (level, axis, encoder = "e") => ({ level, floorMap: { vectors: towards(axis), encoder } });

test("live floors are those of Python half a span later, and the map of the floor is the one that scores", () => {
  const scene = scenes[0];
  const floors = makeFloors(floorOf(scene.levels[0], 0));
  floors.join(scene.levels.slice(1).map((level, k) => floorOf(level, k + 1)));
  const last = scene.t_s.length - 1;
  let met = 0;
  scene.t_s.forEach((tS, k) => {
    const spots = scene.scores[k];
    const mean = spots[0] === null ? null : Float32Array.from({ length: SIZE }, (_, d) => spots[d] ?? (d === SIZE - 1 ? rest(spots) : 0));
    const { level, floorMap, scores } = floors.hear(tS, mean);
    const asked = scene.t_s.indexOf(tS - FLOOR_VOTE.vote_s / 2);
    if (asked < 0) return assert.equal(level, null, "the first moments are not voted on");
    assert.equal(level, scene.sure[asked] ? scene.level[asked] : null, `at ${tS}`);
    if (level !== null) assert.equal(floorMap.vectors[scene.levels.indexOf(level)], 1);
    if (mean && level !== null) assert.ok(Math.abs(scores[0] - spots[scene.levels.indexOf(level)]) < 1e-5);
    met += 1;
  });
  assert.ok(met > last / 2);
});

/** What makes a mean a unit vector, on the last axis. */
const rest = (spots) => Math.sqrt(1 - spots.reduce((sum, score) => sum + score * score, 0));

/** What is heard for some seconds from a moment on; gives the last. */
function heardFor(floors, mean, fromS, seconds) {
  let heard = null;
  for (let tS = fromS; tS <= fromS + seconds; tS += EVERY_S) heard = floors.hear(tS, mean);
  return heard;
}

test("a map alone has no floors", () => {
  const floors = makeFloors(floorOf(undefined, 3));
  assert.equal(heardFor(floors, towards(3), 0, 30).level, undefined);
});

test("the wrong floor is left by the vote, and nothing is known before the others have come", () => {
  const floors = makeFloors(floorOf(0, 0));
  assert.equal(heardFor(floors, towards(1), 0, 30).level, null);
  floors.join([floorOf(1, 1), floorOf(2, 2, "another encoder")]);
  assert.equal(heardFor(floors, towards(1), 31, 9).level, null);
  const { level, floorMap } = heardFor(floors, towards(1), 40.5, 5);
  assert.deepEqual([level, floorMap.vectors[1]], [1, 1]);
  assert.equal(heardFor(floors, towards(2), 46, 30).level, null, "what sounds like neither");
});

test("the walker's word holds until a vote decides, and begins it anew", () => {
  const floors = makeFloors(floorOf(0, 0));
  floors.join([floorOf(1, 1)]);
  const between = towards(0, 1, 1);
  assert.equal(heardFor(floors, towards(1), 0, 30).level, 1);
  floors.say(floorOf(0, 0));
  assert.equal(heardFor(floors, between, 31, 40).level, 0, "floors that sound alike");
  assert.equal(heardFor(floors, towards(1), 72, 30).level, 1);
  floors.say(null);
  const { level, floorMap } = heardFor(floors, towards(1), 103, 9);
  assert.deepEqual([level, floorMap.vectors[1]], [null, 1], "the stairs are on no floor, and the map stays");
  assert.equal(heardFor(floors, null, 113, 40).level, null, "silence tells nothing");
});

/** The way along walked ground: planted lengths and turns, walls that nobody walked through, and the words of it. */

import assert from "node:assert/strict";
import { test } from "node:test";

import {
  pointAlong, walkedGroundOf, wayFrom, wayWords, waysTo,
} from "../../../../src/elfslam/serve/pages/phone/locating/walked_ground.js";
import { labelBox, overlap } from "../../../../src/elfslam/serve/pages/shared/map/points_of_interest.js";

const STEP_M = 0.2;

/** Footsteps on a line. */
function line([x0, y0], [x1, y1]) {
  const count = Math.round(Math.hypot(x1 - x0, y1 - y0) / STEP_M);
  return Array.from({ length: count + 1 }, (_, k) => [x0 + (k / count) * (x1 - x0), y0 + (k / count) * (y1 - y0)]);
}

/** Along a wall, round its end at x = 10, and back along its other side. */
const U_TURN = [...line([0, 0], [10, 0]), ...line([10, 0], [10, 1]), ...line([10, 1], [0, 1])];
const fixAt = (xyM, headingRad = 0, status = "OK") => ({ tS: 0, xyM, headingRad, covarianceM2: [0.01, 0, 0.01], score: 1, status });

test("the way goes round a wall that nobody walked through", () => {
  const way = wayFrom(waysTo(walkedGroundOf(U_TURN), [0, 1]), [0, 0]);
  assert.ok(Math.abs(way.length_m - 21) < 1, `${way.length_m} m`);
  assert.ok(way.line.some(([x]) => x > 9.5), "by its end");
});

test("a straight way is hardly longer than it is", () => {
  const way = wayFrom(waysTo(walkedGroundOf(line([0, 0], [30, 0])), [30, 0.3]), [0, 0.2]);
  assert.ok(Math.abs(way.length_m - 30) < 1, `${way.length_m} m`);
  assert.deepEqual([way.line[0], way.line.at(-1)], [[0, 0.2], [30, 0.3]]);
});

test("two walks that cross are one ground, and the shorter way is taken", () => {
  const loop = [...line([0, 0], [8, 0]), ...line([8, 0], [8, 8]), ...line([8, 8], [0, 8])];
  const ground = walkedGroundOf([...loop, ...line([0, 8], [0, 0])]);
  assert.ok(Math.abs(wayFrom(waysTo(ground, [0, 8]), [0, 0]).length_m - 8) < 0.5);
});

test("where no walk leads there is no way", () => {
  const ground = walkedGroundOf([...line([0, 0], [3, 0]), ...line([0, 9], [3, 9])]);
  assert.equal(wayFrom(waysTo(ground, [0, 9]), [0, 0]), null);
  assert.equal(wayFrom(waysTo(walkedGroundOf([]), [0, 9]), [0, 0]), null);
});

test("every length on a large ground is that of Bellman and Ford", () => {
  let seed = 7;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  const ground = walkedGroundOf(Array.from({ length: 400 }, () => [6 * random(), 6 * random()]));
  const { away_m } = waysTo(ground, ground.points[0]);
  const slow = ground.points.map((_, at) => (at === 0 ? 0 : Infinity));
  for (let round = 0; round < ground.points.length; round += 1) {
    ground.points.forEach((point, at) => ground.near(point).forEach((other) => {
      slow[other] = Math.min(slow[other], slow[at] + Math.hypot(point[0] - ground.points[other][0], point[1] - ground.points[other][1]));
    }));
  }
  away_m.forEach((far_m, at) => assert.ok(far_m === slow[at] || Math.abs(far_m - slow[at]) < 1e-9, `${at}: ${far_m}, ${slow[at]}`));
});

test("a point so far along a line, and its end", () => {
  assert.deepEqual(pointAlong([[0, 0], [1, 0], [1, 4]], 3), [1, 2]);
  assert.deepEqual(pointAlong([[0, 0], [1, 0]], 3), [1, 0]);
});

test("which way, as the walker faces", () => {
  const goal = [20, 0];
  const way = wayFrom(waysTo(walkedGroundOf(line([0, 0], goal)), goal), [0, 0]);
  const said = (headingRad) => wayWords("Room 5", fixAt([0, 0], headingRad), way, goal);
  assert.match(said(0), /^Room 5: 20\u00a0m, straight ahead$/);
  assert.match(said(Math.PI / 2), /to the right$/);
  assert.match(said(-Math.PI / 2), /to the left$/);
  assert.match(said(Math.PI), /behind you$/);
  assert.match(said(-Math.PI / 4), /half left$/);
  assert.match(said(NaN), /east on the map$/);
});

test("the straight line and the way round a wall are both told, each with its turn", () => {
  const goal = [0, 1];
  const way = wayFrom(waysTo(walkedGroundOf(U_TURN), goal), [4, 0]);
  assert.match(wayWords("Desk", fixAt([4, 0]), way, goal), /^Desk: 4.1\u00a0m, behind you; along walked ground 17\u00a0m, first straight ahead$/);
});

test("who stands behind the wall is not there yet", () => {
  const way = wayFrom(waysTo(walkedGroundOf(U_TURN), [2, 1]), [2, 0]);
  assert.match(wayWords("Desk", fixAt([2, 0]), way, [2, 1]), /^Desk: 1.0\u00a0m, to the left; along walked ground 17\u00a0m, first straight ahead$/);
});

test("what is not known is not told", () => {
  assert.match(wayWords("Desk", null, null, [5, 5]), /told once your place is known$/);
  assert.match(wayWords("Desk", fixAt([0, 0], 0, "AMBIGUOUS"), null, [5, 5]), /told once/);
  assert.match(wayWords("Desk", fixAt([0, 0]), null, [5, 5]), /7.1\u00a0m in a straight line, half left; nobody walked all the way$/);
  assert.match(wayWords("Desk", fixAt([5, 4.2]), null, [5, 5]), /you are there$/);
});

test("names on the map leave each other room", () => {
  const here = labelBox([100, 100], 60);
  assert.ok(overlap(here, labelBox([120, 104], 60)));
  assert.ok(!overlap(here, labelBox([100, 130], 60)));
  assert.ok(!overlap(here, labelBox([20, 100], 60)));
});

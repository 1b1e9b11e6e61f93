/** The way along walked ground: planted lengths and turns, walls that nobody walked through, and the words of it. */

import assert from "node:assert/strict";
import { test } from "node:test";

import { floorWayWords, wayWords } from "../../../../src/elfslam/serve/pages/phone/locating/walked_ground.js";
import { pointAlong, wayFrom, wayGraphOf, waysTo, withoutSteps } from "../../../../src/elfslam/serve/pages/stages/ways.js";
import { labelBox, overlap } from "../../../../src/elfslam/serve/pages/shared/map/points_of_interest.js";

const STEP_M = 0.2;

/** Footsteps on a line. */
function line([x0, y0], [x1, y1]) {
  const count = Math.round(Math.hypot(x1 - x0, y1 - y0) / STEP_M);
  return Array.from({ length: count + 1 }, (_, k) => [x0 + (k / count) * (x1 - x0), y0 + (k / count) * (y1 - y0)]);
}

/** Along a wall, round its end at x = 10, and back along its other side. */
const U_TURN = [...line([0, 0], [10, 0]), ...line([10, 0], [10, 1]), ...line([10, 1], [0, 1])];
const at = (xy_m, level = 0) => ({ level, xy_m });
const graphOf = (points) => wayGraphOf([{ level: 0, points }], []);
const wayIn = (points, from_m, goal_m) => wayFrom(waysTo(graphOf(points), at(goal_m)), at(from_m));
const fixAt = (xyM, headingRad = 0, status = "OK") => ({ tS: 0, xyM, headingRad, covarianceM2: [0.01, 0, 0.01], score: 1, status });

test("the way goes round a wall that nobody walked through", () => {
  const way = wayIn(U_TURN, [0, 0], [0, 1]);
  assert.ok(Math.abs(way.length_m - 21) < 1, `${way.length_m} m`);
  assert.ok(way.legs[0].line.some(([x]) => x > 9.5), "by its end");
});

test("a straight way is hardly longer than it is", () => {
  const way = wayIn(line([0, 0], [30, 0]), [0, 0.2], [30, 0.3]);
  assert.ok(Math.abs(way.length_m - 30) < 1, `${way.length_m} m`);
  assert.deepEqual([way.legs[0].line[0], way.legs[0].line.at(-1)], [[0, 0.2], [30, 0.3]]);
});

test("two walks that cross are one ground, and the shorter way is taken", () => {
  const loop = [...line([0, 0], [8, 0]), ...line([8, 0], [8, 8]), ...line([8, 8], [0, 8])];
  assert.ok(Math.abs(wayIn([...loop, ...line([0, 8], [0, 0])], [0, 0], [0, 8]).length_m - 8) < 0.5);
});

test("where no walk leads there is no way", () => {
  assert.equal(wayIn([...line([0, 0], [3, 0]), ...line([0, 9], [3, 9])], [0, 0], [0, 9]), null);
  assert.equal(wayIn([], [0, 0], [0, 9]), null);
});

test("every length on a large ground is that of Bellman and Ford", () => {
  let seed = 7;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  const graph = graphOf(Array.from({ length: 400 }, () => [6 * random(), 6 * random()]));
  const { away_s } = waysTo(graph, at(graph.points[0]));
  const slow = graph.points.map((_, k) => (k === 0 ? 0 : Infinity));
  for (let round = 0; round < graph.points.length; round += 1) {
    graph.points.forEach((_, k) => graph.into(k).forEach(({ from, s }) => {
      slow[from] = Math.min(slow[from], slow[k] + s);
    }));
  }
  away_s.forEach((far_s, k) => assert.ok(far_s === slow[k] || Math.abs(far_s - slow[k]) < 1e-9, `${k}: ${far_s}, ${slow[k]}`));
});

test("a point so far along a line, and its end", () => {
  assert.deepEqual(pointAlong([[0, 0], [1, 0], [1, 4]], 3), [1, 2]);
  assert.deepEqual(pointAlong([[0, 0], [1, 0]], 3), [1, 0]);
});

test("which way, as the walker faces", () => {
  const goal = [20, 0];
  const way = wayIn(line([0, 0], goal), [0, 0], goal);
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
  const way = wayIn(U_TURN, [4, 0], goal);
  assert.match(wayWords("Desk", fixAt([4, 0]), way, goal), /^Desk: 4.1\u00a0m, behind you; along walked ground 17\u00a0m, first straight ahead$/);
});

test("who stands behind the wall is not there yet", () => {
  const way = wayIn(U_TURN, [2, 0], [2, 1]);
  assert.match(wayWords("Desk", fixAt([2, 0]), way, [2, 1]), /^Desk: 1.0\u00a0m, to the left; along walked ground 17\u00a0m, first straight ahead$/);
});

test("what is not known is not told", () => {
  assert.match(wayWords("Desk", null, null, [5, 5]), /told once your place is known$/);
  assert.match(wayWords("Desk", fixAt([0, 0], 0, "AMBIGUOUS"), null, [5, 5]), /told once/);
  assert.match(wayWords("Desk", fixAt([0, 0]), null, [5, 5]), /7.1\u00a0m in a straight line, half left; nobody walked all the way$/);
  assert.match(wayWords("Desk", fixAt([5, 4.2]), null, [5, 5]), /you are there$/);
});

const passage = (kind, x) => ({ kind, from_level: 0, to_level: 1, from_xy_m: [x, 0], to_xy_m: [x, 3], duration_s: 12 });
const FLOORS = [{ level: 0, points: line([0, 0], [30, 0]) }, { level: 1, points: line([0, 3], [30, 3]) }];

test("the way to another floor is told as far as its passage, and anew for who strays", () => {
  const all = [passage("stairs", 10), passage("lift", 20)];
  const by = (passages, x) => wayFrom(waysTo(wayGraphOf(FLOORS, passages), at([5, 3], 1)), at([x, 0]));
  const said = (passages, x, isStepless = false) => floorWayWords("Room 5", 1, fixAt([x, 0]), by(passages, x), isStepless);
  assert.match(said(all, 0), /^Room 5, floor 1: 18\u00a0m; first straight ahead, after 10\u00a0m take the stairs to floor 1$/);
  assert.match(said(all, 12), /first behind you, after 2.0\u00a0m take the stairs/);
  assert.match(said(all, 10), /^Room 5, floor 1: here take the stairs to floor 1; 8.0\u00a0m in all$/);
  assert.match(said(withoutSteps(all), 0, true), /after 20\u00a0m take the lift to floor 1$/);
  assert.match(said([], 0, true), /no way without stairs is known$/);
  assert.match(said([], 0), /nobody walked all the way$/);
  assert.match(floorWayWords("Room 5", 1, null, null, false), /told once your place is known$/);
});

test("names on the map leave each other room", () => {
  const here = labelBox([100, 100], 60);
  assert.ok(overlap(here, labelBox([120, 104], 60)));
  assert.ok(!overlap(here, labelBox([100, 130], 60)));
  assert.ok(!overlap(here, labelBox([20, 100], 60)));
});

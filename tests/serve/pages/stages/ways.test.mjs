/** Ways over floors: those that Python finds. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { wayFrom, wayGraphOf, waysTo } from "../../../../src/elfslam/serve/pages/stages/ways.js";

const { floors, passages, asked } = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS, "utf8"));
const near = (actual, wanted) => assert.ok(Math.abs(actual - wanted) < 1e-6, `${actual} is not ${wanted}`);

test("ways are as long as Python's, and lead through the same places", () => {
  const graph = wayGraphOf(floors, passages);
  for (const { start, goal, wanted } of asked) {
    const way = wayFrom(waysTo(graph, goal), start);
    if (wanted === null) {
      assert.equal(way, null);
      continue;
    }
    near(way.length_m, wanted.length_m);
    near(way.duration_s, wanted.duration_s);
    assert.deepEqual(way.legs.map(({ level, leavesBy }) => [level, leavesBy]), wanted.legs.map(({ level, leaves_by }) => [level, leaves_by]));
    way.legs.forEach(({ line }, k) => {
      assert.equal(line.length, wanted.legs[k].xy_m.length);
      line.flat().forEach((metres, at) => near(metres, wanted.legs[k].xy_m.flat()[at]));
    });
  }
});

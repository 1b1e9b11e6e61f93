// Walkers on the desk's map: the last place of each walk, for ten seconds.

import assert from "node:assert/strict";
import { test } from "node:test";

import { LASTS_MS, stillThere, withPosition, withoutWalk } from "../../../src/elfslam/serve/pages/desk/viewer/live.js";

const told = (more = {}) => ({ walker: "w", walk: "1", name: "Ada", status: "OK", x_m: 1, y_m: 2, heading_rad: 0.5, sigma_m: 0.2, ...more });

test("each walk has one place, the last, and they stand by name", () => {
  const messages = [told(), told({ x_m: 3 }), told({ walk: "2" }), told({ walker: "v", name: "Abe" })];
  const walkers = messages.reduce((all, each, k) => withPosition(all, each, k), []);
  assert.deepEqual(walkers.map(({ name, key, xy_m }) => [name, key, xy_m]), [
    ["Abe", "v 1", [1, 2]], ["Ada", "w 1", [3, 2]], ["Ada", "w 2", [1, 2]]]);
});

test("who is lost stays where they were last, without a circle", () => {
  const lost = told({ status: "UNKNOWN_PLACE", x_m: null, y_m: null, heading_rad: null, sigma_m: null });
  const [walker] = [told(), lost].reduce((all, each) => withPosition(all, each, 0), []);
  assert.deepEqual([walker.xy_m, walker.isPlaced, walker.sigma_m, walker.heading_rad], [[1, 2], false, null, null]);
  assert.equal(withPosition([], lost, 0)[0].xy_m, null);
});

test("a place at nought is a place", () => {
  assert.deepEqual(withPosition([], told({ x_m: 0, y_m: 0 }), 0)[0].xy_m, [0, 0]);
});

test("walks that end go at once, and silent ones in time", () => {
  const walkers = [told(), told({ walk: "2" })].reduce((all, each, k) => withPosition(all, each, k * 5000), []);
  assert.deepEqual(withoutWalk(walkers, told()).map(({ key }) => key), ["w 2"]);
  assert.deepEqual(stillThere(walkers, LASTS_MS - 1).length, 2);
  assert.deepEqual(stillThere(walkers, LASTS_MS).map(({ key }) => key), ["w 2"]);
});

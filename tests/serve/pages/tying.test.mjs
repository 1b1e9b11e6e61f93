// A floor plan is tied to walks by points: planted placements are found again.

import assert from "node:assert/strict";
import { test } from "node:test";

import { planType } from "../../../src/elfslam/serve/pages/desk/viewer/plan_panel.js";
import {
  askFor, noTie, placesOf, scaledTo, tapped, tied, wantedNext,
} from "../../../src/elfslam/serve/pages/desk/viewer/plan_panel.js";
import { firstPlacement, planToMap } from "../../../src/elfslam/serve/pages/shared/map/placement.js";

const now = { width_m: 30, x_m: -3, y_m: 2, heading_rad: 0.4, opacity: 0.6 };
const true_ = { width_m: 24.5, x_m: 7, y_m: -1, heading_rad: -2.1, opacity: 0.6 };
const marks = [[0.1, 0.05], [0.9, 0.1], [0.4, 0.6]];

/** Taps that tie places of the plan, as it lies now, to where they are in truth. */
function tiedBy(count) {
  let tie = noTie("points");
  for (const [u, v] of marks.slice(0, count)) {
    tie = tapped(tie, now, planToMap(now, [u * now.width_m, v * now.width_m]));
    tie = tapped(tie, now, planToMap(true_, [u * true_.width_m, v * true_.width_m]));
  }
  return tie;
}

function near(found, wanted, within = 1e-9) {
  for (const [name, value] of Object.entries(wanted)) assert.ok(Math.abs(found[name] - value) < within, `${name}: ${found[name]} for ${value}`);
}

test("two pairs and three give the planted placement", () => {
  near(tied(tiedBy(2), now), true_);
  near(tied(tiedBy(3), now), true_);
  assert.equal(tied(tiedBy(1), now), null);
});

test("with three pairs an inexact tap is shared out", () => {
  const tie = tiedBy(3);
  const off = { ...tie, map: [tie.map[0], tie.map[1], [tie.map[2][0] + 0.3, tie.map[2][1]]] };
  const found = tied(off, now);
  const errors = placesOf(off, found).map(([x, y], at) => Math.hypot(x - off.map[at][0], y - off.map[at][1]));
  assert.ok(Math.max(...errors) < 0.3 && Math.max(...errors) > 0.01);
  near(found, true_, 1);
});

test("two taps at one place tie nothing", () => {
  let tie = noTie("points");
  for (const xy of [[1, 1], [5, 5], [1, 1], [6, 6]]) tie = tapped(tie, now, xy);
  assert.equal(tied(tie, now), null);
});

test("a known length scales about its first end, and turns nothing", () => {
  const ends = [[1, 4], [6, 9]];
  const tie = ends.reduce((each, xy) => tapped(each, now, xy), noTie("length"));
  const made = scaledTo(tie, now, 10);
  const [one, other] = placesOf(tie, made);
  near({ x: one[0], y: one[1], length: Math.hypot(other[0] - one[0], other[1] - one[1]) }, { x: 1, y: 4, length: 10 });
  assert.equal(made.heading_rad, now.heading_rad);
  for (const length of [NaN, 0, -1, 1e9]) assert.equal(scaledTo(tie, now, length), null);
  assert.equal(scaledTo(noTie("length"), now, 5), null);
});

test("what is tapped next is told at each step", () => {
  let tie = noTie("points");
  const told = [];
  for (let k = 0; k < 7; k += 1) {
    told.push(wantedNext(tie));
    assert.match(askFor(tie), /\w/);
    tie = tapped(tie, now, [k, k * k]);
  }
  assert.deepEqual(told, ["plan", "map", "plan", "map", "plan", "map", null]);
  assert.equal(tie.plan.length, 3, "what comes after the last is not kept");
  const length = [[0, 0], [1, 0], [2, 2]].reduce((each, xy) => tapped(each, now, xy), noTie("length"));
  assert.deepEqual([wantedNext(length), length.plan.length, askFor(length)], [null, 2, "How long is that?"]);
});

test("a plan whose width is known begins with it, in the middle of the walks", () => {
  const { width_m, x_m, y_m } = firstPlacement([0, 0, 10, 6], 0.5, 40);
  assert.deepEqual([width_m, x_m, y_m], [40, -15, -7]);
  assert.equal(firstPlacement([0, 0, 10, 6], 0.5, null).width_m, firstPlacement([0, 0, 10, 6], 0.5).width_m);
});

test("plans are known by how they end", () => {
  assert.equal(planType({ name: "Floor 2.PDF" }), "application/pdf");
  assert.equal(planType({ name: "a.geojson" }), "application/geo+json");
  assert.equal(planType({ name: "a.tiff" }), undefined);
});

// Projection, placement, colours, the nearest, bands and fixes of the map viewer.

import assert from "node:assert/strict";
import { test } from "node:test";

import {
  STEP_OF_SIGMA, cellAt, colourAt, contrast, indexOf, lengthOf, limitsOf, luminance, medianOf, nearest, rgbOf,
  sceneOf, stepAt, stretches, timeColour,
} from "../../../src/elfslam/serve/pages/desk/viewer/scene.js";
import { countStatuses, parseFixes } from "../../../src/elfslam/serve/pages/desk/viewer/scene.js";
import {
  corners, firstPlacement, imageMatrix, isOnPlan, mapToPlan, middle, moved, planToMap, rounded, stretched, turned, widened, wrapped,
} from "../../../src/elfslam/serve/pages/shared/map/placement.js";
import { focusAt, grabPlan, nextFocus, snapped, tell } from "../../../src/elfslam/serve/pages/desk/viewer/canvas.js";
import { fit, pan, pinch, scaleBar, toMap, toScreen, zoomAt } from "../../../src/elfslam/serve/pages/shared/map/projection.js";

const SIZE = { width: 800, height: 600 };
const VIEW = { x_m: 2, y_m: -1, px_per_m: 50 };
const PLAN = { width_m: 10, x_m: 1, y_m: 2, heading_rad: 0.3, opacity: 0.5 };
const ASPECT = 0.6;

const near = (actual, wanted, slack = 1e-9) =>
  [actual].flat().forEach((value, at) => assert.ok(Math.abs(value - [wanted].flat()[at]) <= slack, `${actual} is not ${wanted}`));

test("the middle of the canvas is the view's place, and y runs up", () => {
  assert.deepEqual(toScreen(VIEW, SIZE, [2, -1]), [400, 300]);
  assert.deepEqual(toScreen(VIEW, SIZE, [3, 0]), [450, 250]);
  near(toMap(VIEW, SIZE, toScreen(VIEW, SIZE, [7.25, -3.5])), [7.25, -3.5]);
});

test("what is fitted lies whole and centred inside the margin", () => {
  const view = fit([0, 0, 20, 5], SIZE, 40);
  near(toScreen(view, SIZE, [0, 2.5]), [40, 300]);
  near(toScreen(view, SIZE, [20, 2.5]), [760, 300]);
  assert.ok(fit([1, 1, 1, 1], SIZE).px_per_m < Infinity, "a single point has a view too");
});

test("zooming and pinching keep the map under the fingers", () => {
  const at = [123, 456];
  const held = toMap(VIEW, SIZE, at);
  near(toScreen(zoomAt(VIEW, SIZE, at, 3), SIZE, held), at, 1e-6);
  const [before, after] = [[[100, 100], [300, 100]], [[50, 140], [450, 140]]];
  const spread = pinch(VIEW, SIZE, before, after);
  near(spread.px_per_m, 100);
  before.forEach((finger, k) => near(toScreen(spread, SIZE, toMap(VIEW, SIZE, finger)), after[k], 1e-6));
  near(toScreen(pan(VIEW, [30, -20]), SIZE, toMap(VIEW, SIZE, [0, 0])), [30, -20]);
});

test("zooming ends somewhere", () => {
  let view = VIEW;
  for (let turn = 0; turn < 200; turn += 1) view = zoomAt(view, SIZE, [10, 10], 2);
  assert.equal(view.px_per_m, 4000);
});

test("the scale bar is a round length that fits", () => {
  assert.deepEqual(scaleBar(50, 140), { length_m: 2, length_px: 100 });
  assert.deepEqual(scaleBar(100, 100), { length_m: 1, length_px: 100 });
  near(scaleBar(0.5, 140).length_m, 200);
  near(scaleBar(900, 140).length_m, 0.1);
});

test("a plan's corner lies where the placement says, and back", () => {
  near(corners(PLAN, ASPECT)[0], [1, 2]);
  near(corners(PLAN, ASPECT)[1], [1 + 10 * Math.cos(0.3), 2 + 10 * Math.sin(0.3)]);
  near(mapToPlan(PLAN, planToMap(PLAN, [3, 4])), [3, 4]);
  assert.ok(isOnPlan(PLAN, ASPECT, middle(PLAN, ASPECT)));
  assert.ok(!isOnPlan(PLAN, ASPECT, [0.9, 2]));
});

test("turning and widening keep the middle, stretching the far corner", () => {
  near(middle(turned(PLAN, ASPECT, 2), ASPECT), middle(PLAN, ASPECT));
  near(turned(PLAN, ASPECT, 2).heading_rad, 2);
  near(middle(widened(PLAN, ASPECT, 25), ASPECT), middle(PLAN, ASPECT));
  for (const corner of [0, 1, 2, 3]) {
    const far = (corner + 2) % 4;
    const target = corners(widened(PLAN, ASPECT, 14), ASPECT)[corner];
    const out = stretched(PLAN, ASPECT, corner, target);
    near(corners(out, ASPECT)[far], corners(PLAN, ASPECT)[far]);
    near(out.width_m, 12);
    near(corners(stretched(PLAN, ASPECT, corner, corners(PLAN, ASPECT)[corner]), ASPECT).flat(), corners(PLAN, ASPECT).flat());
    assert.equal(stretched(PLAN, ASPECT, corner, corners(PLAN, ASPECT)[far]).width_m, 0.1, "never inside out");
  }
});

test("a first placement holds the walks, centred", () => {
  const plan = firstPlacement([0, 0, 20, 10], ASPECT);
  near(middle(plan, ASPECT), [10, 5], 1e-3);
  for (const xy of [[0, 0], [20, 10]]) assert.ok(isOnPlan(plan, ASPECT, xy));
});

test("what is saved is rounded, and angles are wrapped", () => {
  assert.deepEqual(rounded({ ...PLAN, x_m: 1.23456, heading_rad: 0.3 + 2 * Math.PI, opacity: 1.7 }), { ...PLAN, x_m: 1.235, opacity: 1 });
  near(wrapped(3 * Math.PI), -Math.PI);
  near(snapped(Math.PI / 2 + 0.01), Math.PI / 2);
  near(snapped(0.1), 0.1);
});

test("the image's matrix puts its pixels where the plan lies", () => {
  const [a, b, c, d, e, f] = imageMatrix(PLAN, ASPECT, (xy) => toScreen(VIEW, SIZE, xy));
  const at = (u, v) => [a * u + c * v + e, b * u + d * v + f];
  const [lowerLeft, lowerRight, upperRight] = corners(PLAN, ASPECT).map((xy) => toScreen(VIEW, SIZE, xy));
  near(at(0, 1), lowerLeft, 1e-9);
  near(at(1, 1), lowerRight, 1e-9);
  near(at(1, 0), upperRight, 1e-9);
});

test("a drag on the plan moves it by as much, at a corner stretches it, at the knob turns it", () => {
  const plan = { placement: { ...PLAN, heading_rad: 0 }, aspect: ASPECT };
  const state = { plan, view: { x_m: 6, y_m: 5, px_per_m: 40 }, size: SIZE, placing: true };
  const px = (xy) => toScreen(state.view, SIZE, xy);
  const inside = grabPlan(state, px([6, 5]), 12);
  near([inside(px([7.5, 4])).x_m, inside(px([7.5, 4])).y_m], [2.5, 1]);
  const corner = grabPlan(state, px([11, 8]), 12);
  near(corner(px([16, 11])).width_m, 15);
  const [knob_x, knob_y] = px([6, 8]);
  const knob = grabPlan(state, [knob_x, knob_y - 34], 12);
  near(knob(px([0, 5])).heading_rad, Math.PI / 2);
  assert.equal(grabPlan(state, px([30, 30]), 12), null, "beside the plan the map is dragged");
  assert.equal(grabPlan({ ...state, placing: false }, px([6, 5]), 12), null);
});

test("scales of colour grow lighter all the way, so that they read without hues", () => {
  for (const scale of ["viridis", "cividis"]) {
    const lights = Array.from({ length: 33 }, (_, k) => luminance(colourAt(scale, k / 32)));
    assert.ok(lights.every((light, k) => k === 0 || light > lights[k - 1]), scale);
  }
  assert.deepEqual(colourAt("cividis", 0), rgbOf("00224e"));
  assert.deepEqual(colourAt("viridis", 2), rgbOf("#fde725"));
});

test("walks coloured by time stand out from the ground, light and dark", () => {
  for (let share = 0; share <= 1; share += 0.05) {
    assert.ok(contrast(timeColour(share, false), rgbOf("ffffff")) > 2.5, `light ${share}`);
    assert.ok(contrast(timeColour(share, true), rgbOf("19211e")) > 2.5, `dark ${share}`);
  }
  near(contrast(rgbOf("000000"), rgbOf("ffffff")), 21, 1e-9);
});

test("limits leave out what is not known", () => {
  assert.deepEqual(limitsOf([[null, 3], [1, null]]), { low: 1, high: 3 });
  assert.equal(limitsOf([[null]]), null);
  const { low, high } = limitsOf([[2, 2]]);
  assert.ok(high > low);
});

test("the nearest of many points, found as by looking at all", () => {
  let seed = 1;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647;
  const points = Array.from({ length: 3000 }, () => [random() * 60, random() * 30]);
  const index = indexOf(points);
  for (let turn = 0; turn < 200; turn += 1) {
    const at = [random() * 64 - 2, random() * 34 - 2];
    const away = points.map(([x, y]) => Math.hypot(x - at[0], y - at[1]));
    const best = away.indexOf(Math.min(...away));
    assert.equal(nearest(index, at, 0.8), away[best] <= 0.8 ? best : null);
    assert.equal(nearest(index, at, 500), best);
  }
  assert.equal(nearest(index, points[7], 1, (row) => row !== 7) === 7, false);
  assert.equal(nearest(indexOf([]), [0, 0], 5), null);
});

test("a band is cut where the sigma changes, without gaps and within a step of the truth", () => {
  const xy = Array.from({ length: 40 }, (_, k) => [k, 0]);
  const sigma = xy.map((_, k) => 0.05 * 1.08 ** k);
  const found = stretches(xy, sigma);
  assert.ok(found.length > 10 && found.length < 40);
  found.slice(1).forEach(({ points }, k) => {
    const last = found[k].points;
    assert.deepEqual(last[last.length - 1], points[0], "neighbours meet");
  });
  assert.deepEqual(found.flatMap(({ points }, k) => (k === 0 ? points : points.slice(1))), xy);
  for (const { sigma_m, points } of found) {
    const given = sigma[points[0][0]];
    assert.ok(Math.abs(Math.log(sigma_m / given)) <= Math.log(STEP_OF_SIGMA) / 2 + 1e-9);
  }
  assert.deepEqual(stretches([[0, 0], [1, 0]], [null, 0]), []);
});

const GIVEN = {
  kind: "floor",
  bounds_m: [0, 0, 4, 3],
  walks: [
    { name: "one", t_s: [0, 1, 2], xy_m: [[0, 0], [3, 0], [3, 3]], sigma_m: [0.1, 0.2, 0.3] },
    { name: "two", t_s: [], xy_m: [[4, 3], [4, 1]], sigma_m: [] },
  ],
  dead_reckoning: [],
  closures: [],
  coverage: { corner_m: [0, 0], cell_m: 2, shape: [2, 2], walks: [[1, 2], [0, 2]], sigma_m: [[0.1, 0.2], [null, null]] },
};

test("a scene knows its walks, their lengths, and which footstep is which", () => {
  const scene = sceneOf(GIVEN);
  assert.equal(scene.walks[0].length_m, 6);
  assert.equal(scene.walks[0].middle_sigma_m, 0.2);
  assert.equal(scene.walks[1].duration_s, 0);
  assert.deepEqual(stepAt(scene, 2), { walk: 0, step: 2 });
  assert.deepEqual(stepAt(scene, 3), { walk: 1, step: 0 });
  assert.deepEqual(scene.bounds_m, [0, 0, 4, 3]);
  assert.equal(lengthOf([]), 0);
  assert.equal(medianOf([]), null);
});

test("a map without a single walk is a scene as well", () => {
  const scene = sceneOf({ ...GIVEN, walks: [], coverage: null });
  assert.equal(focusAt(scene, stateOf(), [0, 0], 5), null);
  assert.equal(nextFocus(scene, stateOf(), 1), null);
});

test("the square at a place, none where nobody walked", () => {
  assert.deepEqual(cellAt(GIVEN.coverage, [2.5, 0.5]), { walks: 2, sigma_m: 0.2 });
  assert.equal(cellAt(GIVEN.coverage, [0.5, 2.5]), null);
  assert.equal(cellAt(GIVEN.coverage, [9, 9]), null);
});

function stateOf(more = {}) {
  const layers = { trajectories: true, fixes: true, coverage: true };
  return { layers, hidden: new Set(), located: [], focus: null, ...more };
}

test("what is under the finger is told: walk, time, sigma; hidden walks are not there", () => {
  const scene = sceneOf(GIVEN);
  const focus = focusAt(scene, stateOf(), [2.9, 2.8], 0.5);
  assert.deepEqual(focus, { kind: "step", walk: 0, step: 2 });
  assert.deepEqual(tell(scene, stateOf(), focus), { name: "one", line: "at 0:02 · footstep 3 · x 3.00, y 3.00 m · ± 0.30 m" });
  assert.deepEqual(focusAt(scene, stateOf({ hidden: new Set([0]) }), [2.9, 2.8], 0.5), { kind: "cell", xy_m: [2.9, 2.8] });
  assert.doesNotMatch(tell(scene, stateOf(), { kind: "step", walk: 1, step: 1 }).line, /NaN|–|at /, "a time that is not known is left out");
  const cell = { kind: "cell", xy_m: [0.5, 0.5] };
  assert.deepEqual(tell(scene, stateOf(), cell), { name: "1 walk here", line: "places are known to ± 0.10 m" });
});

test("a fix lies over the walks, and says whether it is to be believed", () => {
  const scene = sceneOf(GIVEN);
  const fixes = parseFixes("t_s,x_m,y_m,heading_rad,sigma_m,status\n1.5,3,2.9,0.1,0.25,AMBIGUOUS\n2.5,,,,,NO_ECHO\n");
  const state = stateOf({ located: [{ id: "a", name: "a visitor", fixes, shown: true }] });
  const focus = focusAt(scene, state, [3, 3], 0.5);
  assert.deepEqual(focus, { kind: "fix", located: 0, fix: 0 });
  assert.match(tell(scene, state, focus).line, /^several places sound alike · at 0:01 · x 3\.00, y 2\.90 m · ± 0\.25 m$/);
  state.located[0].shown = false;
  assert.equal(focusAt(scene, state, [3, 3], 0.5).kind, "step");
});

test("stepping goes through every footstep that is shown and round", () => {
  const scene = sceneOf(GIVEN);
  const state = stateOf();
  const seen = [];
  for (let turn = 0; turn < 6; turn += 1) {
    state.focus = nextFocus(scene, state, 1);
    seen.push(`${state.focus.walk}${state.focus.step}`);
  }
  assert.deepEqual(seen, ["00", "01", "02", "10", "11", "00"]);
  state.hidden.add(0);
  state.focus = null;
  assert.deepEqual(nextFocus(scene, state, -1), { kind: "step", walk: 1, step: 1 });
});

test("fixes are read by the names of their columns, empty cells are unknown", () => {
  const fixes = parseFixes("status,t_s,x_m,y_m,heading_rad,sigma_m\r\nOK,0.3,1,2,0,0.1\r\nUNKNOWN_PLACE,0.9,,,,\r\n");
  assert.deepEqual(fixes[0], { t_s: 0.3, xy_m: [1, 2], heading_rad: 0, sigma_m: 0.1, status: "OK" });
  assert.equal(fixes[1].xy_m, null);
  assert.equal(fixes[1].sigma_m, null);
  assert.deepEqual(countStatuses([...fixes, fixes[0]]), [["OK", 2], ["UNKNOWN_PLACE", 1]]);
  assert.throws(() => parseFixes("t_s,x_m\n1,2\n"), /lack the column y_m/);
});

test("fixes of a building are those of one floor, and those of no floor have no place", () => {
  const text = "t_s,x_m,y_m,heading_rad,sigma_m,status,level\n1,1,2,0,0.1,OK,0\n2,3,4,0,0.1,OK,1\n3,5,6,0,0.1,AMBIGUOUS,\n";
  const told = parseFixes(text, 1).map(({ t_s, xy_m }) => [t_s, xy_m]);
  assert.deepEqual(told, [[2, [3, 4]], [3, null]]);
});

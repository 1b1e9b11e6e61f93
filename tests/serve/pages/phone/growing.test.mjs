// The map that grows: from steps and what is heard to a sketch, its words, and what is said of chirps.

import assert from "node:assert/strict";
import { test } from "node:test";

const PAGES = "../../../../src/elfslam/serve/pages/phone";
const { confirmedShare, makeSketch, nextStretch, drawBySteps } = await import(`${PAGES}/growing/sketch.js`);
const { adviceOf } = await import(`${PAGES}/growing/growing.js`);
const { makeChirpWatch, louderOn } = await import(`${PAGES}/recording_controller.js`);
const { checkpointRows } = await import(`${PAGES}/walking.js`);
const { placeAt } = await import(`${PAGES}/growing/tapping.js`);

const CLOSURE = {
  threshold: 0.35, back_margin: 0.4, near_footsteps: 12, half_sequence: 6, half_peak: 2, ridge_footsteps: 3,
  rival_margin: 0.05, along_sigma_m: 0.2, across_sigma_m: 0.28, heading_sigma_rad: 0.28,
};
const LAP = 40;
const SIDE_M = 7;
/** A gyroscope that reads too much: dead reckoning bends. */
const BENT_RAD = 0.01;
const SIGMA = [0.1, 0.05, 0.03];

function placesOn(count) {
  let state = 5;
  const random = () => (state = (16807 * state) % 2147483647) / 2147483647 - 0.5;
  return Array.from({ length: count }, () => {
    const vector = Float32Array.from({ length: 128 }, random);
    const norm = Math.hypot(...vector);
    return vector.map((each) => each / norm);
  });
}

/** Two laps round a square, heard alike, by bent dead reckoning. */
function walked(sketch, steps = 2 * LAP, heard = placesOn(LAP), from = 0) {
  for (let k = from; k < from + steps; k += 1) {
    const turn = (k % 10 === 9 ? Math.PI / 2 : 0) + BENT_RAD;
    sketch.step({ fromS: k / 2, tS: (k + 1) / 2, moveM: [SIDE_M / 10, 0, turn], sigma: SIGMA }, heard[k % LAP]);
  }
  return sketch.now();
}

const apartM = (poses, i, j) => Math.hypot(poses[3 * i] - poses[3 * j], poses[3 * i + 1] - poses[3 * j + 1]);

test("a second lap closes loops and pulls the map straight", () => {
  const { poses, loops } = walked(makeSketch(CLOSURE));
  assert.ok(loops.length > 3, `${loops.length} loops`);
  for (const [i, j] of loops) assert.equal(j - i, LAP);
  const deaf = walked(makeSketch(CLOSURE), 2 * LAP, Array(LAP).fill(null));
  assert.deepEqual(deaf.loops, []);
  assert.ok(apartM(deaf.poses, 20, 60) > 1, `bent by ${apartM(deaf.poses, 20, 60)}`);
  assert.ok(apartM(poses, 20, 60) < 0.2, `apart by ${apartM(poses, 20, 60)}`);
});

test("a second lap by a noisy phone closes loops by what its successive echoes have in common", () => {
  const faint = placesOn(LAP).map((vector) => vector.map((each) => 0.5 * each));
  const alike = [0.25 * 0.45];
  const loopsAt = (echoDb) => {
    const sketch = makeSketch(CLOSURE, echoDb);
    for (let k = 0; k < 2 * LAP; k += 1)
      sketch.step({ fromS: k / 2, tS: (k + 1) / 2, moveM: [SIDE_M / 10, 0, k % 10 === 9 ? Math.PI / 2 : 0], sigma: SIGMA },
        faint[k % LAP], alike);
    return sketch.now().loops.length;
  };
  assert.equal(loopsAt(20), 0, "of a quiet phone this is another place");
  assert.equal(loopsAt(null), 0);
  assert.ok(loopsAt(5) > 3);
});

test("a place that is marked again closes a loop by hand", () => {
  const sketch = makeSketch(CLOSURE);
  const silent = Array(LAP).fill(null);
  sketch.mark("Door", 5);
  walked(sketch, LAP, silent);
  sketch.mark("Door", 25);
  const shown = walked(sketch, 20, silent, LAP);
  assert.deepEqual(shown.marks.map(({ name }) => name), ["Door", "Door"]);
  const [first, again] = shown.marks.map(({ at }) => at);
  assert.deepEqual([first, again], [10, 50]);
  assert.deepEqual(shown.loops, [[first, again]]);
});

test("a tap waits for the footstep at which it came", () => {
  const sketch = makeSketch(CLOSURE);
  sketch.mark("Stairs", 9.9);
  assert.deepEqual(walked(sketch, 18, [null]).marks, []);
  sketch.step({ fromS: 9, tS: 10, moveM: [0.7, 0, 0], sigma: SIGMA }, null);
  assert.deepEqual(sketch.now().marks, [{ name: "Stairs", at: 19 }]);
});

test("where a walk was interrupted the map does not hold together until a loop does it", () => {
  const sketch = makeSketch(CLOSURE);
  const heard = placesOn(LAP);
  sketch.gap();
  walked(sketch, LAP, heard);
  sketch.gap();
  const shown = walked(sketch, LAP, heard, LAP);
  assert.deepEqual(shown.gaps, [LAP + 1], "a walk does not begin with a gap");
  assert.ok(shown.loops.length > 0);
  assert.ok(shown.loops.every(([i, j]) => j - i === LAP + 1));
});

test("what to walk next is the longest stretch that no loop confirms", () => {
  assert.equal(nextStretch(200, []), null, "nothing is closed yet: the way back to the start is best");
  assert.deepEqual(nextStretch(200, [[10, 60], [12, 62]]), [77, 200]);
  assert.deepEqual(nextStretch(70, [[5, 60]]), [20, 45]);
  assert.equal(nextStretch(60, [[15, 45]]), null);
});

test("advice follows what is known", () => {
  assert.equal(adviceOf({ loops: [], next: null }, 10), "");
  assert.match(adviceOf({ loops: [], next: null }, 60), /closes the first loop/);
  assert.match(adviceOf({ loops: [[1, 50]], next: [10, 30] }, 60), /dashed part/);
  assert.match(adviceOf({ loops: [[1, 50]], next: null }, 60), /not been, or stop/);
});

test("a walk is confirmed around the ends of its loops", () => {
  assert.equal(confirmedShare(100, []), 0);
  assert.equal(confirmedShare(100, [[20, 60]]), 0.62);
  assert.equal(confirmedShare(100, [[20, 60], [22, 62]]), 0.66);
  assert.equal(confirmedShare(40, [[0, 30]]), 1, "nothing beyond the walk counts");
});

test("footsteps are drawn once they are over, with what was heard between them", () => {
  const [step] = [{ fromS: 0.5, tS: 1, moveM: [0.7, 0, 0], sigma: SIGMA }];
  const asked = [];
  const memory = { mean: (...span) => asked.push(span) && null, alike: () => [], forget: (tS) => asked.push(tS) };
  const waiting = [step];
  const { decide } = drawBySteps({ sketch: makeSketch(CLOSURE), memory, footsteps: { take: () => waiting.splice(0) } });
  assert.deepEqual(decide(0.9), [], "not over yet");
  assert.equal(decide(1.2)[0].poses.length, 6);
  assert.deepEqual(asked, [[0.5, 1], 1]);
});

const QUIET = {};
const told = (chirps, settings = QUIET, agent = "") => {
  const watch = makeChirpWatch(() => settings, agent);
  return chirps.map(([peak, isFound]) => watch(peak, isFound)).at(-1);
};
const many = (peak, isFound = true, count = 25) => Array(count).fill([peak, isFound]);

test("nothing is said of chirps that are well, nor of one that is lost", () => {
  assert.equal(told(many(0.05)), null);
  assert.equal(told([...many(0.05), [0, false]]), null);
  assert.equal(told(many(0, false, 10)), null, "too early to say");
});

test("what is wrong with chirps is said with what to do on this phone", () => {
  const iphone = "Mozilla/5.0 (iPhone; CPU iPhone OS 18_0 like Mac OS X)";
  assert.match(told(many(0.05, false), QUIET, iphone), /not heard.*silent mode/);
  assert.match(told(many(0.0002), QUIET, "Linux; Android 15"), /hardly heard.*media/);
  assert.match(told(many(0.002)), /are soft\. Turn the volume up/);
  assert.match(told([...many(0.05), ...many(0.01)]), /much softer/);
  assert.match(told(many(0.05), { noiseSuppression: true }), /begun to work on the sound/);
  assert.equal(told(many(0.05), { noiseSuppression: false, echoCancellation: false }), null);
  assert.notEqual(louderOn(iphone), louderOn(""));
});

test("a checkpoint is a row, whatever its name", () => {
  const timeOf = (pageMs) => pageMs / 1000 - 1;
  const marked = [{ name: 'Door, "left"', pageMs: 3500, xyM: null }, { name: "b", pageMs: 100, xyM: [0, -2.5] }];
  assert.equal(checkpointRows(marked, timeOf), '2.500,"Door, ""left""",,\n0.000,"b",0.000,-2.500\n');
});

test("a tap near a place that has a name means that place", () => {
  const points = [{ name: "Way in", kind: "door", x_m: 3, y_m: 4 }, { name: "Stairs", kind: "stairs", x_m: 4, y_m: 4 }];
  assert.equal(placeAt(points, [3.9, 4.2]).name, "Stairs");
  assert.equal(placeAt(points, [3.2, 4.2]).name, "Way in");
  assert.equal(placeAt(points, [3, 6]), null);
  assert.equal(placeAt([], [3, 4]), null);
});

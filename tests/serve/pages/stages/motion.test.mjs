// Motion in the page equals motion on the line, stage by stage.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import {
  bounceRms,
  findPeaks,
  footfalls,
  lengthsBetween,
  makeFootsteps,
  notGiven,
  phoneTurn,
  restKept,
  smoothHeading,
  verticalBounce,
} from "../../../../src/elfslam/serve/pages/stages/motion/live.js";
import { inRunsOf, level } from "../../../../src/elfslam/serve/pages/stages/motion/filters.js";
import { columnsOf, roundHalfEven, wrapAngle } from "../../../../src/elfslam/serve/pages/stages/motion/filters.js";

const { parameters, walks, live, peaks } = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS));

function close(got, wanted, what, within = 1e-6) {
  assert.equal(got.length, wanted.length, `${what}: ${got.length} values, wanted ${wanted.length}`);
  for (let k = 0; k < wanted.length; k += 1) {
    assert.ok(Math.abs(got[k] - wanted[k]) <= within, `${what}[${k}]: ${got[k]}, wanted ${wanted[k]}`);
  }
}

function closeAxes(got, wanted, what, within) {
  columnsOf(wanted).forEach((column, axis) => close(got[axis], column, `${what} ${"xyz"[axis]}`, within));
}

for (const [name, walk] of Object.entries(walks)) {
  const levelled = level(walk.imu, parameters);
  const bounce = verticalBounce(levelled, parameters);

  test(`${name}: the sensors on an even clock, without the bias at rest`, () => {
    assert.ok(Math.abs(levelled.rateHz / walk.rate_hz - 1) < 1e-12);
    close(levelled.tS, walk.even.tS, "time", 1e-9);
    closeAxes(levelled.accel, walk.even.accel, "acceleration");
    closeAxes(levelled.gyro, walk.even.gyro, "rate of turn");
  });

  test(`${name}: what points up`, () => closeAxes(levelled.up, walk.up, "up"));

  test(`${name}: the bounce and its strength`, () => {
    close(bounce, walk.bounce, "bounce");
    close(bounceRms(bounce, parameters.bounce_window_s, levelled.rateHz), walk.rms, "rms");
  });

  test(`${name}: footsteps, lengths and headings`, () => {
    const footstepsS = footfalls(levelled, bounce, parameters);
    close(footstepsS, walk.footsteps_s, "footstep");
    const lengthsM = lengthsBetween(levelled, bounce, footstepsS, parameters);
    close(lengthsM, walk.lengths_m, "length");
    close(phoneTurn(levelled), walk.turn_rad, "turn");
    close(smoothHeading(levelled, parameters), walk.heading_rad, "heading");
  });
}

function readingOf({ tS, accelMps2, gyroRadps }, k) {
  return [tS[k], accelMps2.slice(3 * k, 3 * k + 3), gyroRadps.slice(3 * k, 3 * k + 3)];
}

for (const [name, walk] of Object.entries(live)) {
  test(`${name}: live steps are the line's, lot by lot`, () => {
    const footsteps = makeFootsteps(parameters);
    const told = walk.lots.map((_, lot) => {
      const stop = Math.min((lot + 1) * walk.every, walk.imu.tS.length);
      for (let k = lot * walk.every; k < stop; k += 1) footsteps.push(...readingOf(walk.imu, k));
      return footsteps.take(walk.imu.tS[stop - 1]);
    });
    assert.deepEqual(told.map((steps) => steps.length), walk.lots);
    const rows = told.flat().flatMap(({ tS, fromS, moveM, sigma }) => [tS, fromS, ...moveM, ...sigma]);
    assert.ok(rows.length > 8 * 20, `${rows.length / 8} steps`);
    close(rows, walk.steps, "step");
  });
}

test("readings that come late or twice are left out, and later ones wait", () => {
  const { imu } = live.browser;
  const [clean, mixed] = [makeFootsteps(parameters), makeFootsteps(parameters)];
  for (let k = 0; k < 900; k += 1) {
    clean.push(...readingOf(imu, k));
    mixed.push(...readingOf(imu, k));
    if (k > 5) mixed.push(...readingOf(imu, k - 3));
  }
  for (let k = 900; k < 1000; k += 1) mixed.push(...readingOf(imu, k));
  const steps = clean.take();
  assert.ok(steps.length > 5);
  assert.deepEqual(mixed.take(imu.tS[899]), steps);
  assert.ok(mixed.take().length > 0);
  assert.deepEqual(mixed.take(), []);
});

test("a footstep near the last given is that one, and a rest is not cut to pieces", () => {
  assert.deepEqual(notGiven([9.5, 10.01, 10.1, 10.16], [9.4, 10], parameters), [10.16]);
  const isStill = Array.from({ length: 40 }, (_, k) => k >= 10 && k < 30);
  assert.deepEqual([0, 3, 16, 25, 30].map((cut) => restKept(isStill, cut, 10)), [0, 3, 16, 20, 30]);
});

test("stillness counts from a shortest run on", () => {
  const shown = (text) => inRunsOf([...text].map((each) => each === "x"), 3).map((each) => (each ? "x" : ".")).join("");
  assert.deepEqual(["xx.xxx.xxxx", "xxx", "xx", "..xxx"].map(shown), ["...xxx.xxxx", "xxx", "..", "..xxx"]);
});

test("peaks, plateaus and prominences", () => {
  for (const each of peaks) {
    const found = findPeaks(Float64Array.from(each.values), 1, 0.5);
    close(found.peaks, each.peaks, "peak", 0);
    close(found.prominences, each.prominences, "prominence", 1e-12);
    const apart = findPeaks(Float64Array.from(each.values, (value, k) => value + 1e-9 * k), 12, 0.5);
    close(apart.peaks, each.apart, "peak apart", 0);
    close(apart.prominences, each.apart_prominences, "prominence apart", 1e-12);
  }
});

test("halves round to even and angles wrap as in Python", () => {
  assert.deepEqual([0.5, 1.5, 2.5, 2.4, 2.6].map(roundHalfEven), [0, 2, 2, 2, 3]);
  assert.deepEqual([Math.PI, -Math.PI, 0].map(wrapAngle), [-Math.PI, -Math.PI, 0]);
});

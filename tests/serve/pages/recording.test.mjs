// What a recording's page draws and says: curves, ticks, rates, files; and which dropped files are taken.

import assert from "node:assert/strict";
import { test } from "node:test";

import {
  extentOf, factsOf, filesOf, pathOf, rateText, readingText, runsOf, shareDown, spanOf, stretchAt, summaryOf,
  tickText, ticksOf, timeAt, titleOf,
} from "../../../src/elfslam/serve/pages/desk/recording_page.js";
import { pageOf } from "../../../src/elfslam/serve/pages/desk/session.js";
import { ENDINGS, readable } from "../../../src/elfslam/serve/pages/desk/recordings_view.js";

const curve = (low, high, name = "acceleration") => ({ name, unit: "m/s²", start_s: 0, step_s: 1, low, high });

test("a recording has an address of its own", () => {
  assert.deepEqual(pageOf("#/recordings"), { name: "recordings", id: "" });
  assert.deepEqual(pageOf("#/recordings/a%2Fb"), { name: "recording", id: "a/b" });
});

test("an extent holds every value and is never flat", () => {
  assert.deepEqual(extentOf(curve([1, null, -2], [3, null, 9])), { low: -2, high: 9 });
  assert.equal(extentOf(curve([null], [null])), null);
  for (const flat of [0, 9.8, -1e-3, 5e4]) {
    const { low, high } = extentOf(curve([flat], [flat]));
    assert.ok(low < flat && flat < high);
  }
  assert.deepEqual(extentOf(curve([4, 2], [4, 7], "access points")), { low: 0, high: 7 }, "counts begin at zero");
});

test("ticks are round, inside, and few", () => {
  for (const [low, high] of [[0, 1], [-3.2, 17], [9.79, 9.83], [-120, 0], [48000, 48100], [-1e-6, 2e-6]]) {
    const ticks = ticksOf({ low, high });
    assert.ok(ticks.length >= 2 && ticks.length <= 6, `${low} to ${high}: ${ticks}`);
    assert.ok(ticks.every((tick) => tick >= low - 1e-9 && tick <= high + 1e-9));
  }
  assert.deepEqual(ticksOf({ low: -3.2, high: 17 }), [0, 5, 10, 15]);
  assert.equal(tickText(-120), "−120");
  assert.equal(tickText(0.30000000000000004), "0.3");
  assert.equal(shareDown({ low: 0, high: 10 }, 10), 0);
  assert.equal(shareDown({ low: 0, high: 10 }, 2.5), 0.75);
});

test("a gap parts a curve in two", () => {
  assert.deepEqual(runsOf([1, 2, null, 3, null, null]), [[0, 1], [3, 3]]);
  assert.deepEqual(runsOf([null]), []);
  const made = curve([0, 0, null, 5], [10, 10, null, 10]);
  const path = pathOf(made, { low: 0, high: 10 }, spanOf([made]), { width: 40, height: 100 });
  assert.equal(path, "M5 0L15 0L15 100L5 100ZM35 0L35 50Z");
});

test("curves of one page share their time", () => {
  const early = { ...curve([1, 1], [2, 2]), start_s: 0, step_s: 1 };
  const late = { ...curve([1], [2]), start_s: 3, step_s: 1 };
  const span = spanOf([early, late]);
  assert.deepEqual(span, { start_s: 0, end_s: 4 });
  assert.equal(timeAt(span, 0.5), 2);
  assert.match(pathOf(late, { low: 0, high: 2 }, span, { width: 400, height: 10 }), /^M350 /);
});

test("counts are bars from zero", () => {
  const made = curve([null, 4], [null, 4], "access points");
  assert.equal(pathOf(made, { low: 0, high: 8 }, spanOf([made]), { width: 20, height: 80 }), "M15 80V40");
});

test("what is under the finger is told in words", () => {
  const made = curve([-1.25, null], [2, null]);
  assert.equal(stretchAt(made, 0.6), 0);
  assert.equal(stretchAt(made, 2), 1);
  assert.equal(stretchAt(made, -3), 0);
  assert.equal(readingText(made, 0), "−1.25 to 2 m/s²");
  assert.equal(readingText(made, 1), "nothing read");
  assert.equal(readingText(curve([3], [3]), 0), "3 m/s²");
  assert.equal(summaryOf(made), "Acceleration: −1.25 to 2 m/s²");
  assert.equal(titleOf(curve([], [], "something new")), "something new");
});

test("facts come with rates once the sensors are read", () => {
  const shared = { duration: "1:00", bytes: "2 MB", count: String };
  const recording = { facts: { sensors: ["imu", "wifi"], footsteps: 80, imported: "sensorlogger", damaged_lines: 0 } };
  const before = factsOf(recording, null, shared);
  assert.deepEqual(before, [["Duration", "1:00"], ["Footsteps", "80"], ["Size", "2 MB"], ["Recorded with", "Sensor Logger"], ["Motion", "…"], ["Wi-Fi scans", "…"]]);
  const look = { sensors: [{ name: "audio", readings: 9, rate_hz: 44100 }, { name: "imu", readings: 9, rate_hz: 99.7 }, { name: "wifi", readings: 12, rate_hz: 0.4 }], curves: [], chirps_played: 600, chirps_heard_share: 0.997 };
  const noted = { facts: { ...recording.facts, notes: ["the clock was put back", "two taps"] } };
  assert.deepEqual(factsOf(noted, null, shared)[4], ["Noted when it was read", "the clock was put back; two taps"]);
  const after = factsOf(recording, look, shared).slice(4);
  assert.deepEqual(after, [["Chirps played", "600"], ["Chirps heard", "99 %"], ["Sound", "44.1 kHz"], ["Motion", "100 Hz"], ["Wi-Fi scans", "12"]]);
  assert.equal(rateText(0.83), "0.83 Hz");
});

test("tables come first among the files, each with what it holds", () => {
  const files = ["recording.json", "gyroscope.csv", "audio.flac", "new.bin"].map((name) => ({ name, size_bytes: 1 }));
  const told = filesOf(files);
  assert.deepEqual(told.map(({ name }) => name), ["gyroscope.csv", "audio.flac", "new.bin", "recording.json"]);
  assert.equal(told[0].words, "Turn rates, rad/s");
  assert.equal(told[2].words, "");
});

test("files are taken by how they end; the server looks into them", () => {
  const names = ["a.zip", "B.TXT", "site.tar.xz", "m.mat", "notes.pdf", "zip", "a.zip.part"];
  const { taken, refused } = readable(names.map((name) => ({ name })));
  assert.deepEqual(taken.map(({ name }) => name), names.slice(0, 4));
  assert.deepEqual(refused, names.slice(4));
  assert.equal(ENDINGS.length, 4);
});

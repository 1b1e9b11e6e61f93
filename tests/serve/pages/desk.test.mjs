// Words, routes, waits and sums of the desk page.

import assert from "node:assert/strict";
import { test } from "node:test";

import { commonName, mapJob, sensesOf } from "../../../src/elfslam/serve/pages/desk/dialogs.js";
import { apart, courseOf, keptOf, stretchOf } from "../../../src/elfslam/serve/pages/desk/jobs_view.js";
import { factsOf, queryOf } from "../../../src/elfslam/serve/pages/desk/maps_view.js";
import {
  fileName, formatAgo, formatBytes, formatCount, formatDuration, formatMetres, formatShare, parseTime,
  secondsBetween, withoutMarks,
} from "../../../src/elfslam/serve/pages/shared/format.js";
import { PACE, isMoving, jobTitle, mappingOf, nextWait } from "../../../src/elfslam/serve/pages/desk/store.js";
import { bytesOf, shareCome } from "../../../src/elfslam/serve/pages/desk/recordings_view.js";
import { pageOf } from "../../../src/elfslam/serve/pages/desk/session.js";
import { counted } from "../../../src/elfslam/serve/pages/shared/words.js";

test("numbers as people read them, a dash where nothing is known", () => {
  assert.equal(formatBytes(1_400_000), "1.4\u00a0MB");
  assert.equal(formatBytes(null), "–");
  assert.equal(formatDuration(3723), "1:02:03");
  assert.equal(formatDuration(undefined), "–");
  assert.equal(formatMetres(0.043), "4 cm");
  assert.equal(formatMetres(2), "2.00 m");
  assert.equal(formatMetres(123.45), "123.5 m");
  assert.equal(formatMetres(2150), "2.15 km");
  assert.equal(formatShare(0.404), "40 %");
  assert.equal(formatShare(7), "100 %");
  assert.equal(formatShare(null), "");
  assert.equal(formatCount(1234567), "1,234,567");
  assert.equal(counted(1, "{{count, number}} walk", "{{count, number}} walks"), "1 walk");
  assert.equal(counted(1200, "{{count, number}} walk", "{{count, number}} walks"), "1,200 walks");
});

test("marks of a merge are left out, but where they tell namesakes apart", () => {
  const shown = (...names) => [...withoutMarks(names).values()];
  assert.deepEqual(shown("hall-3fa9c1", "yard-0b1c2d"), ["hall", "yard"]);
  assert.deepEqual(shown("hall-3fa9c1", "hall-0b1c2d", "attic"), ["hall-3fa9c1", "hall-0b1c2d", "attic"]);
  assert.deepEqual(shown("hall-3fa9c1", "hall"), ["hall-3fa9c1", "hall"]);
  assert.deepEqual(shown("-3fa9c1", "walk-two"), ["-3fa9c1", "walk-two"]);
});

test("times without a zone are UTC, as the database keeps them", () => {
  assert.equal(parseTime("2026-11-21T18:00:00"), Date.UTC(2026, 10, 21, 18));
  assert.equal(parseTime("2026-11-21T19:00:00+01:00"), Date.UTC(2026, 10, 21, 18));
  assert.equal(parseTime(null), null);
  assert.equal(parseTime("yesterday"), null);
  const now = Date.UTC(2026, 10, 21, 18);
  assert.equal(formatAgo("2026-11-21T17:59:30Z", now), "just now");
  assert.equal(formatAgo("2026-11-21T17:20:00", now), "40 min ago");
  assert.equal(formatAgo("2026-11-20T17:00:00Z", now), "1 day ago");
  assert.equal(formatAgo("2026-10-01T00:00:00Z", now), "Oct 1, 2026");
  assert.equal(secondsBetween("2026-11-21T17:59:00Z", null, now), 60);
  assert.equal(secondsBetween("2026-11-21T17:59:00Z", "2026-11-21T17:59:09Z", now), 9);
});

test("names of files keep letters of any tongue and nothing that a path needs", () => {
  assert.equal(fileName("Büro, 2. Stock"), "Büro-_2._Stock");
  assert.equal(fileName("../../etc/passwd"), "etc-passwd");
  assert.equal(fileName("///"), "map");
});

test("waits grow while nothing moves and are short while something does", () => {
  let wait = PACE.fast_ms;
  const waits = Array.from({ length: 12 }, () => (wait = nextWait(wait, false)));
  assert.ok(waits.every((each, k) => k === 0 || each >= waits[k - 1]));
  assert.equal(waits[11], PACE.slow_ms);
  assert.equal(nextWait(wait, true), PACE.fast_ms);
});

test("addresses and what they open", () => {
  assert.deepEqual(pageOf(""), { name: "recordings", id: "" });
  assert.deepEqual(pageOf("#/maps"), { name: "maps", id: "" });
  assert.deepEqual(pageOf("#/maps/a%2Fb"), { name: "map", id: "a/b" });
  assert.deepEqual(pageOf("#/maps/%zz"), { name: "map", id: "%zz" });
  assert.deepEqual(pageOf("#/"), { name: "recordings", id: "" });
  assert.deepEqual(pageOf("#/users"), { name: "users", id: "" });
  assert.deepEqual(pageOf("#link=a.b&key=c"), { name: "shared", id: "a.b" });
  for (const wrong of ["#/nonsense", "#/maps/a/b", "#/jobs/1", "#/toString", "#/map"]) {
    assert.deepEqual(pageOf(wrong), { name: "missing", id: "" }, wrong);
  }
});

test("how much of an upload has come; unknown while the walk goes on", () => {
  const upload = (offset_bytes, length_bytes) => ({ id: "u", file_name: "f", offset_bytes, length_bytes });
  assert.equal(shareCome({ uploads: [upload(50, 100), upload(100, 200)] }), 0.5);
  assert.equal(shareCome({ uploads: [upload(50, 100), upload(1, null)] }), null);
  assert.equal(shareCome({ uploads: [] }), null);
  assert.equal(bytesOf({ facts: {}, files: [{ size_bytes: 7 }], uploads: [upload(5, null)] }), 12);
  assert.equal(bytesOf({ facts: { bytes: 99 }, files: [], uploads: [] }), 99);
});

test("a job to map asks for what was ticked, motion where nothing was", () => {
  const answer = new FormData();
  assert.deepEqual(mapJob("r", answer), { kind: "map", recording: "r", by: ["motion"] });
  answer.append("by", "elf");
  answer.append("by", "wifi");
  for (const [name, value] of [["declared", "on"], ["x_m", "1.5"], ["y_m", "-2"], ["heading", "90"]]) answer.append(name, value);
  assert.deepEqual(mapJob("r", answer), { kind: "map", recording: "r", by: ["elf", "wifi"], start_pose: [1.5, -2, Math.PI / 2] });
});

test("a stretch is asked for only where not all is meant", () => {
  assert.deepEqual(stretchOf(0, 60.2, 60.23), {});
  assert.deepEqual(stretchOf(4.3, 60.2, 60.23), { from_s: 4.3 });
  assert.deepEqual(stretchOf(0, 50.1, 60.23), { until_s: 50.1 });
  const answer = new FormData();
  for (const [name, value] of [["by", "elf"], ["from_s", "12.3"], ["until_s", "40"]]) answer.append(name, value);
  assert.deepEqual(mapJob("r", answer, 60), { kind: "map", recording: "r", by: ["elf"], from_s: 12.3, until_s: 40 });
  assert.deepEqual(mapJob("r", answer), { kind: "map", recording: "r", by: ["elf"] });
});

test("the two ends of a stretch give way to each other", () => {
  assert.deepEqual(apart([10, 30], "from", 60), [10, 30]);
  assert.deepEqual(apart([29, 30], "from", 60), [29, 31]);
  assert.deepEqual(apart([59, 60], "from", 60), [58, 60]);
  assert.deepEqual(apart([29, 30], "until", 60), [28, 30]);
  assert.deepEqual(apart([0, 1], "until", 60), [0, 2]);
});

test("a time line has the lanes that are known, and there is none of what is too short", () => {
  const facts = { duration_s: 60, spans_s: { motion: [[0, 20], [23, 60]], sound: [[0.7, 59]] } };
  assert.deepEqual(courseOf({ facts }).lanes, [["Sound", [[0.7, 59]]], ["Motion", [[0, 20], [23, 60]]]]);
  assert.deepEqual(courseOf({ facts: { duration_s: 60 } }), { duration_s: 60, lanes: [] });
  assert.equal(courseOf({ facts: { duration_s: 1 } }), null);
  assert.equal(courseOf({ facts: {} }), null);
});

test("what was mapped of a recording is told by its map", () => {
  assert.deepEqual(keptOf({ kept_s: [5, 1e6] }), [5, 1e6]);
  assert.equal(keptOf({}), null);
  assert.equal(keptOf(undefined), null);
});

test("senses are those that the recording brings", () => {
  const files = (...names) => ({ files: names.map((name) => ({ name, size_bytes: 1 })) });
  assert.deepEqual(sensesOf(files("recording.json", "baseband.iq", "baseband.csv", "wifi.csv")), ["elf", "wifi"]);
  assert.deepEqual(sensesOf(files("audio.flac", "magnetometer.csv")), ["elf", "magnetic"]);
  assert.deepEqual(sensesOf(files("accelerometer.csv")), []);
});

test("several maps are named by what their names share", () => {
  assert.equal(commonName([{ name: "Floor 2, walk 1" }, { name: "Floor 2, walk 2" }]), "Floor 2, walk");
  assert.equal(commonName([{ name: "abc" }, { name: "xyz" }]), "Floor");
});

test("an export is asked with what its format needs and what was filled in", () => {
  const inputs = new Map(Object.entries({ origin: { value: " 47.3,8.5 " }, name: { value: "Hall" }, level: { value: "" } }));
  assert.equal(queryOf("tum", inputs), "");
  assert.equal(queryOf("geojson", inputs), "?origin=47.3%2C8.5");
  assert.equal(queryOf("imdf", inputs), "?origin=47.3%2C8.5&name=Hall");
});

const KNOWN = {
  loaded: true,
  recordings: [{ id: "r", name: "walk", state: "ready" }],
  maps: [{ id: "m", name: "hall", kind: "run", sources: ["r"], created_utc: "1" }, { id: "f", name: "floor", kind: "floor", sources: ["r", "s"], created_utc: "2" }],
  jobs: [{ id: "j", kind: "map", state: "done", given: { recording: "r" }, gave: { map: "m" } }],
};

test("jobs are named by what they work on, even where that is gone", () => {
  assert.equal(jobTitle(KNOWN.jobs[0], KNOWN), "walk");
  assert.equal(jobTitle({ kind: "merge", given: { maps: ["m", "x"] } }, KNOWN), "hall + a deleted map");
  assert.equal(jobTitle({ kind: "locate", given: { recording: "x", map: "f" } }, KNOWN), "a deleted recording in floor");
});

test("a recording knows its own map, and no floor that it is part of", () => {
  assert.equal(mappingOf("r", KNOWN).map.id, "m");
  assert.equal(mappingOf("s", KNOWN).map, undefined);
  assert.equal(isMoving(KNOWN), false);
  assert.equal(isMoving({ ...KNOWN, jobs: [{ state: "queued" }] }), true);
  assert.equal(isMoving({ ...KNOWN, recordings: [{ state: "receiving" }] }), false, "an upload left lying");
});

test("facts that are not numbers are not known", () => {
  const facts = factsOf({ facts: { footsteps: 140, closures: 200, closures_kept: 180, walks: ["a"] } });
  assert.deepEqual(facts, { footsteps: 140, closures: 180, walks: null, distance_m: null });
  assert.equal(factsOf({ facts: {} }).closures, null);
});

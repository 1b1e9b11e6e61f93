// Motion, clocks, words and files of the phone page.

import assert from "node:assert/strict";
import { createHash } from "node:crypto";
import { test } from "node:test";

import {
  eventTime, fitClocks, readClocks, soundTime, withPair,
} from "../../../../src/elfslam/serve/pages/phone/clocks.js";
import { parseStart, walkKey } from "../../../../src/elfslam/serve/pages/phone/view.js";
import {
  NO_FACTS, cutsFor, deviceIn, lastTime, manifestOf,
} from "../../../../src/elfslam/serve/pages/phone/manifest.js";
import {
  NO_STEPS, accelerationOf, accelerationSign, countStep, describeMotion, tableRow, turningOf,
} from "../../../../src/elfslam/serve/pages/phone/motion.js";
import { joined } from "../../../../src/elfslam/serve/pages/phone/byte_stores.js";
import { toPcm, wavHeader } from "../../../../src/elfslam/serve/pages/phone/framer.js";
import { troubleOf } from "../../../../src/elfslam/serve/pages/phone/sending.js";
import { judge, summarise } from "../../../../src/elfslam/serve/pages/phone/verdicts.js";
import { makeChirpLog, makeLateness, makeMotionLog } from "../../../../src/elfslam/serve/pages/phone/walking.js";
import { secretIn } from "../../../../src/elfslam/serve/pages/shared/api.js";
import {
  formatBytes,
  formatDuration,
  formatMoment,
  missingLine,
  missingWords,
} from "../../../../src/elfslam/serve/pages/shared/format.js";
import { fingerprintOf } from "../../../../src/elfslam/serve/pages/trust.js";

const IPHONE = "Mozilla/5.0 (iPhone; CPU iPhone OS 18_1 like Mac OS X) AppleWebKit/605.1.15 Version/18.1";
const ANDROID = "Mozilla/5.0 (Linux; Android 14; Pixel 8) AppleWebKit/537.36 Chrome/130.0 Mobile Safari/537.36";

test("on its back every phone reads gravity upwards, in its own sign", () => {
  const sign = accelerationSign({ userAgent: IPHONE });
  assert.equal(sign, -1);
  assert.equal(accelerationSign({ userAgent: ANDROID }), 1);
  assert.equal(accelerationSign({ userAgent: "Macintosh", platform: "MacIntel", maxTouchPoints: 5 }), -1);
  assert.equal(accelerationSign({ userAgent: "Macintosh", platform: "MacIntel", maxTouchPoints: 0 }), 1);
  const reading = { accelerationIncludingGravity: { x: 0.5, y: -1, z: -9.8 } };
  assert.deepEqual(accelerationOf(reading, sign), [-0.5, 1, 9.8]);
});

test("turning is in radians about x, y and z", () => {
  assert.deepEqual(turningOf({ rotationRate: { alpha: 180, beta: -90, gamma: 0 } }), [Math.PI, -Math.PI / 2, 0]);
});

test("what a sensor does not know is no reading", () => {
  assert.equal(accelerationOf({ accelerationIncludingGravity: { x: null, y: 1, z: 2 } }, 1), null);
  assert.equal(accelerationOf({ accelerationIncludingGravity: null }, 1), null);
  assert.equal(turningOf({ rotationRate: null }), null);
});

test("rows of a table are what elfslam reads", () => {
  assert.equal(tableRow(1.5, [0.1, -2, 9.80665]), "1.500000,0.100000,-2.000000,9.806650\n");
});

test("motion is described by its rate, its strength and its longest gap", () => {
  const times = Array.from({ length: 61 }, (_, k) => (1000 * k) / 60);
  const described = describeMotion(times, times.map(() => [0, 0, 9.8]));
  assert.ok(Math.abs(described.rateHz - 60) < 1e-9);
  assert.ok(Math.abs(described.gravityMps2 - 9.8) < 1e-9);
  assert.equal(describeMotion([], []).rateHz, 0);
});

test("steps are counted as they are made", () => {
  let steps = NO_STEPS;
  for (let k = 0; k < 60 * 20; k += 1) {
    const tS = k / 60;
    steps = countStep(steps, tS, [0, 3, 9.3 + 2.5 * Math.sin(2 * Math.PI * 1.8 * tS)]);
  }
  assert.ok(Math.abs(steps.count - 36) <= 1, `${steps.count} steps, wanted 36`);
});

test("a phone that lies still makes no steps", () => {
  let steps = NO_STEPS;
  for (let k = 0; k < 600; k += 1) steps = countStep(steps, k / 60, [0, 0, 9.8 + 0.1 * (k % 2)]);
  assert.equal(steps.count, 0);
});

test("a drifting and jittering clock is followed", () => {
  const pairs = Array.from({ length: 300 }, (_, k) => ({
    pageMs: 5000 + 200 * k,
    soundS: 2 + 0.2 * k * (1 + 50e-6) + 0.003 * Math.sin(k * 1.7),
  }));
  const line = fitClocks(pairs);
  assert.ok(Math.abs(line.rate - 1 - 50e-6) < 30e-6);
  assert.ok(Math.abs(soundTime(line, 5000 + 200 * 150) - (2 + 30 * (1 + 50e-6))) < 0.0005);
});

test("where the sound stalled, pairs of before mislead and are left out", () => {
  let pairs = [];
  for (let k = 0; k < 20; k += 1) pairs = withPair(pairs, { pageMs: 200 * k, soundS: 1 + 0.2 * k }, 15);
  assert.equal(pairs.length, 15);
  pairs = withPair(pairs, { pageMs: 9000, soundS: 5.2 }, 15);
  assert.deepEqual(pairs, [{ pageMs: 9000, soundS: 5.2 }]);
  pairs = withPair(pairs, { pageMs: 9200, soundS: 5.39 }, 15);
  assert.equal(pairs.length, 2);
  assert.ok(Math.abs(soundTime(fitClocks(pairs), 9100) - 5.295) < 0.01);
});

test("a rate that no clock has is taken for noise", () => {
  const line = fitClocks([{ pageMs: 0, soundS: 0 }, { pageMs: 10, soundS: 0.02 }, { pageMs: 20, soundS: 0.04 }]);
  assert.equal(line.rate, 1);
  assert.equal(fitClocks([{ pageMs: 100, soundS: 3 }]).originS, 3);
});

test("where the context gives no stamp, now stands for now", () => {
  const context = { currentTime: 4, outputLatency: 0.02, getOutputTimestamp: () => ({ contextTime: 0, performanceTime: 0 }) };
  assert.deepEqual(readClocks(context, 77), { pageMs: 77, soundS: 3.98 });
  const good = { ...context, getOutputTimestamp: () => ({ contextTime: 3.9, performanceTime: 70 }) };
  assert.deepEqual(readClocks(good, 77), { pageMs: 70, soundS: 3.9 });
});

test("stamps of another clock are not believed", () => {
  assert.equal(eventTime(990, 1000), 990);
  assert.equal(eventTime(1.7e12, 1000), 1000);
});

test("motion is kept in order of time, from the start of the recording on", () => {
  const seen = [];
  const log = makeMotionLog((tS) => seen.push(tS));
  for (const pageMs of [-10, 20, 10, 20, 30]) log.add(pageMs, [0, 0, 9.8], [0, 0, 1]);
  const rows = log.take((pageMs) => pageMs / 1000);
  const times = rows["gyroscope.csv"].trim().split("\n").map((row) => row.split(",")[0]);
  assert.deepEqual(times, ["0.020000", "0.030000"]);
  assert.deepEqual(rows["accelerometer.csv"].match(/^0\.\d+/gm), times);
  assert.equal(log.take((pageMs) => pageMs)["gyroscope.csv"], "");
});

test("a walk that goes on takes no motion of before", () => {
  const log = makeMotionLog(() => {}, 12.5);
  for (const pageMs of [12400, 12600]) log.add(pageMs, [0, 0, 9.8], [0, 0, 1]);
  const rows = log.take((pageMs) => pageMs / 1000);
  assert.deepEqual(Object.values(rows).map((text) => text.split(",")[0]), ["12.600000", "12.600000"]);
});

test("motion waits for the sound that belongs to it", () => {
  const log = makeMotionLog(() => {});
  for (const pageMs of [10, 20, 30]) log.add(pageMs, [0, 0, 9.8], null);
  const timesUntil = (untilS) =>
    log.take((pageMs) => pageMs / 1000, untilS)["accelerometer.csv"].match(/^0\.\d+/gm) ?? [];
  assert.deepEqual(timesUntil(0.02), ["0.010000", "0.020000"]);
  assert.deepEqual(timesUntil(0.02), []);
  assert.deepEqual(timesUntil(0.5), ["0.030000"]);
});

test("the way of the sound is known from its first chirp, and followed where it jumps", () => {
  const late = makeLateness();
  assert.equal(late.latencyS(), null);
  assert.equal(late.endS(), undefined);
  for (let c = 0; c < 20; c += 1) late.add(0.52 + 0.1 * c, 0.27);
  assert.ok(Math.abs(late.latencyS() - 0.27) < 1e-9);
  for (let c = 20; c < 40; c += 1) late.add(0.56 + 0.1 * c, 0.31);
  assert.ok(Math.abs(late.latencyS() - 0.31) < 1e-9);
  assert.ok(Math.abs(late.endS() - (0.56 + 3.9 + 0.075)) < 1e-9);
});

test("a chirp that was heard before any was told of says nothing of the way of the sound", () => {
  const late = makeLateness();
  late.add(0.52, null);
  assert.equal(late.latencyS(), null);
  assert.ok(Math.abs(late.endS() - (0.52 + 0.075)) < 1e-9);
  late.add(0.62, 0.27);
  assert.equal(late.latencyS(), 0.27);
});

test("chirps are written down once they have begun, and those called back never", () => {
  const log = makeChirpLog(48000, 48000);
  for (const [frame, gainDb] of [[60000, 0], [64801, -4], [69600, 0], [74400, -4]]) log.add(frame, gainDb);
  assert.equal(log.take(64801), "0.250000000,0\n");
  assert.equal(log.take(70000), "0.350020833,-4\n0.450000000,0\n");
  assert.equal(log.take(70000), "");
});

const EARS = {
  label: "Built-in", contextRateHz: 48000, outputLatencyS: 0.03,
  settings: { sampleRate: 48000, echoCancellation: false, noiseSuppression: false, autoGainControl: false },
};
const HEARD = {
  peak: 0.1, contrast: 50, heard: 20, frames: 20, jitterS: 1e-5, latencyS: 0.03, clippedShare: 0, silentShare: 0,
  subbands: [15, 16, 17, 18, 19].map((kilohertz) => ({ lowHz: 1000 * kilohertz, levelDb: -50, snrDb: 40 })),
};
const MOVED = { rateHz: 60, gravityMps2: 9.8 };

function verdictOf(name, ears, heard = {}, moved = {}, free = 1e10) {
  const checks = judge({ ...EARS, ...ears }, { ...HEARD, ...heard }, { ...MOVED, ...moved }, free);
  return checks.find((check) => check.name === name);
}

test("a good phone passes every check", () => {
  const checks = judge(EARS, HEARD, MOVED, 1e10);
  assert.deepEqual(checks.map((check) => check.verdict), Array(7).fill("pass"));
  assert.deepEqual(summarise(checks), { verdict: "pass", said: "This phone can do it." });
});

test("each fault is told in its own line, with what to do", () => {
  const cases = [
    ["Microphone", { label: "Buds Pro (Bluetooth)" }, {}, {}, "fail", /Take it off/],
    ["Microphone", { settings: { ...EARS.settings, sampleRate: 16000 } }, {}, {}, "fail", /8 kHz.*Bluetooth/],
    ["Microphone", { outputLatencyS: 0.3 }, {}, {}, "doubt", /300 ms/],
    ["Untouched sound", { settings: { ...EARS.settings, echoCancellation: true } }, {}, {}, "fail", /echo cancellation/],
    ["Untouched sound", { settings: { sampleRate: 48000 } }, {}, {}, "doubt", /does not say/],
    ["Loudness", {}, { silentShare: 1, peak: 0 }, {}, "fail", /unmute/],
    ["Loudness", {}, { clippedShare: 0.01 }, {}, "fail", /down/],
    ["Loudness", {}, { peak: 0.0001 }, {}, "fail", /up/],
    ["Loudness", {}, { peak: 0.002 }, {}, "doubt", /up/],
    ["15 to 20 kHz", {}, { subbands: HEARD.subbands.map((band, k) => ({ ...band, snrDb: k > 2 ? 1 : 40 })) }, {}, "fail", /18–19 kHz, 19–20 kHz/],
    ["15 to 20 kHz", {}, { subbands: HEARD.subbands.map((band) => ({ ...band, snrDb: 12 })) }, {}, "doubt", /quieter/],
    ["Steady timing", {}, { heard: 3 }, {}, "fail", /3 of 20/],
    ["Steady timing", {}, { jitterS: 0.004 }, {}, "fail", /4\.0 ms/],
    ["Steady timing", {}, { jitterS: 0.0006 }, {}, "doubt", /0\.6 ms/],
    ["Motion", {}, {}, { rateHz: 0, gravityMps2: NaN }, "fail", /Allow motion/],
    ["Motion", {}, {}, { gravityMps2: 0.1 }, "fail", /Gravity/],
    ["Motion", {}, {}, { rateHz: 30 }, "doubt", /30 readings/],
  ];
  for (const [name, ears, heard, moved, verdict, said] of cases) {
    const check = verdictOf(name, ears, heard, moved);
    assert.equal(check.verdict, verdict, `${name}: ${check.said}`);
    assert.match(check.said, said);
  }
  assert.equal(verdictOf("Room on this phone", {}, {}, {}, 5e6).verdict, "fail");
  assert.equal(verdictOf("Room on this phone", {}, {}, {}, null).verdict, "pass");
});

test("the whole is as good as its worst part", () => {
  const bad = judge({ ...EARS, label: "Headset" }, { ...HEARD, heard: 17 }, MOVED, 1e10);
  assert.equal(summarise(bad).verdict, "fail");
  assert.match(summarise(bad).said, /microphone/);
  assert.equal(summarise(judge(EARS, { ...HEARD, heard: 17 }, MOVED, 1e10)).verdict, "doubt");
});

test("every trouble is told, and tried again only where that helps", () => {
  assert.match(troubleOf(0, "", 0).said, /No network.*kept/);
  assert.deepEqual([0, 1, 2, 9].map((attempt) => troubleOf(0, "", attempt).retryS), [1, 2, 4, 15]);
  assert.match(troubleOf(507, "", 0).said, /disk is full.*kept/);
  assert.ok(troubleOf(507, "", 0).retryS > 0);
  assert.equal(troubleOf(429, "", 0, 7).retryS, 7);
  assert.equal(troubleOf(401, "", 0).retryS, null);
  assert.deepEqual(troubleOf(413, "too large", 0), { said: "too large", retryS: null });
  assert.match(troubleOf(410, "", 0).said, /begins anew/);
  assert.ok(troubleOf(502, "", 0).retryS > 0);
});

test("a walk that broke off is cut to whole frames and whole rows", () => {
  const sound = { table: "t_s\n0.1\n0.2\n0.3\n0.", frameBytes: 10, headerBytes: 0, fileBytes: 27 };
  assert.deepEqual(cutsFor(sound, { "a.csv": "t_s,x\n1,2\n3", "b.csv": "t_s,x\n1,2\n" }), {
    sound: { table: 12, file: 20 },
    tables: { "a.csv": 10 },
  });
  assert.deepEqual(cutsFor({ ...sound, table: "t_s\n0.1\n", fileBytes: 27 }, {}).sound, { file: 10 });
  assert.deepEqual(cutsFor({ table: "t_s\n0.1\n0.2\n", frameBytes: 10, headerBytes: 44, fileBytes: 64 }, {}).sound, {});
  assert.equal(lastTime("t_s\n0.1\n0.25\n0."), 0.25);
  assert.equal(lastTime("t_s\n"), 0);
  assert.equal(lastTime("t_s,scale\n0.1,2e-5\n0.25,3e-5\n"), 0.25);
});

test("the manifest says what was played, kept and heard", () => {
  const walk = {
    version: 1, name: "W", device: "D", startPose: [1, 2, 0.5], startUtc: "2026-01-02T03:04:05.000Z",
    kind: "baseband", rateHz: 48000, chirp: { kind: "chirp" }, capture: { microphone: "M" },
    facts: { ...NO_FACTS, seconds: 2, frames: 20, missed: 3, jumps: [{ t_s: 1, by_s: 0.01 }] },
  };
  const manifest = JSON.parse(manifestOf(walk, "page"));
  assert.equal(manifest.format_version, 1);
  assert.deepEqual(manifest.start_pose, [1, 2, 0.5]);
  assert.deepEqual(manifest.audio, { rate_hz: 48000, channels: 1, samples: 96000 });
  assert.deepEqual(manifest.baseband, {
    rate_hz: 6300, centre_hz: 17500, frame_samples: 504, scale: 1 / 32767, source_rate_hz: 48000, lead_s: 0.005,
  });
  assert.equal(manifest.capture.missed, 3);
  assert.equal(JSON.parse(manifestOf({ ...walk, scale: 1e-5 }, "page")).baseband.scale, 1e-5);
  assert.equal("baseband" in JSON.parse(manifestOf({ ...walk, kind: "whole" }, "page")), false);
  const silent = JSON.parse(manifestOf({ ...walk, facts: NO_FACTS }, "page"));
  assert.deepEqual([silent.audio, "baseband" in silent], [null, false]);
});

test("a phone is named by what its browser tells", () => {
  assert.equal(deviceIn(ANDROID), "Pixel 8, Android 14");
  assert.equal(deviceIn(IPHONE), "iPhone");
  assert.equal(deviceIn(""), "unknown");
});

test("a start is three numbers or nothing", () => {
  assert.equal(parseStart("", " ", ""), null);
  assert.deepEqual(parseStart("1,5", "−2", "180"), [1.5, -2, Math.PI]);
  assert.throws(() => parseStart("1", "", "0"), /leave all three empty/);
  assert.throws(() => parseStart("one", "2", "3"), RangeError);
});

test("keys of walks sort by time and fit in a file name", () => {
  const key = walkKey(new Date("2026-01-02T03:04:05.678Z"), 0.5);
  assert.match(key, /^20260102T030405Z-[0-9a-f]{4}$/);
  assert.ok(key < walkKey(new Date("2026-01-02T03:04:06Z"), 0));
});

test("pieces in the database are read across their borders", () => {
  const pieces = [{ start: 0, bytes: Uint8Array.of(0, 1, 2) }, { start: 3, bytes: Uint8Array.of(3, 4) }];
  assert.deepEqual([...joined(pieces, 2, 5)], [2, 3, 4]);
  assert.deepEqual([...joined(pieces.slice(1), 4, 5)], [4]);
});

test("a WAV that was streamed says so", () => {
  const view = new DataView(wavHeader(48000).buffer);
  assert.equal(view.byteLength, 44);
  assert.equal(view.getUint32(24, true), 48000);
  assert.equal(view.getUint32(40, true), 0xffffffff);
  assert.deepEqual([...toPcm(Float32Array.of(1, -1, 2))], [255, 127, 1, 128, 255, 127]);
});

test("what pairs is taken from the fragment", () => {
  assert.deepEqual(secretIn("#token=a-b_c"), { kind: "token", secret: "a-b_c" });
  assert.deepEqual(secretIn("#code=d&key=e"), { kind: "code", secret: "d" });
  assert.equal(secretIn("#key=e"), null);
  assert.equal(secretIn(""), null);
});

test("numbers are written for people", () => {
  assert.deepEqual([999, 1500, 20000, 1.5e6, 2e7, 3e9].map(formatBytes).map((text) => text.replace("\u00a0", " ")), ["999 B", "1.5 kB", "20 kB", "1.5 MB", "20 MB", "3.0 GB"]);
  assert.deepEqual([0, 61, 3723].map(formatDuration), ["0:00", "1:01", "1:02:03"]);
});

test("the fingerprint is the digest of the certificate", async () => {
  const pem = "-----BEGIN CERTIFICATE-----\nYWJj\n-----END CERTIFICATE-----\n";
  const whole = await fingerprintOf(pem);
  assert.equal(whole.replaceAll(":", ""), createHash("sha256").update("abc").digest("hex").toUpperCase());
  assert.equal(whole.split(":").length, 32);
  await assert.rejects(fingerprintOf("no certificate"), /no certificate/);
});

test("what a walk lacks is told from when until when", () => {
  assert.equal(formatMoment(59.96), "1:00.0");
  assert.equal(formatMoment(3725.34), "1:02:05.3");
  const hole = { what: "motion", from_s: 12, until_s: 15.25 };
  assert.equal(missingLine(hole), "Motion is missing from 0:12.0 to 0:15.3");
  assert.equal(missingWords(undefined), "");
  assert.equal(missingWords([]), "");
  const many = [hole, { ...hole, what: "sound" }, { ...hole, what: "light" }];
  assert.equal(
    missingWords(many, 2),
    "Motion is missing from 0:12.0 to 0:15.3; Sound is missing from 0:12.0 to 0:15.3; 1 more stretch like it.",
  );
  assert.match(missingWords(many, 1), /2 more stretches like it\.$/);
  assert.match(missingWords(many), /light is missing/);
});

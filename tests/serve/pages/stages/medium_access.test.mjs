// Slots and listening in the page against elfslam.stages.medium_access: vectors come from test_line_medium_access.py.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { NOTHING_HEARD, hearSlot } from "../../../../src/elfslam/serve/pages/stages/hearing.js";
import { isSpoiled, lookAt, makeSpoiled } from "../../../../src/elfslam/serve/pages/stages/spoiled.js";
import { MEDIUM_ACCESS } from "../../../../src/elfslam/serve/pages/stages/constants.js";
import { afterSlot, isPlayed, initialSchedule } from "../../../../src/elfslam/serve/pages/stages/hearing.js";

const vectors = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS, "utf8"));

test("the parameters are elfslam's", () => assert.deepEqual(MEDIUM_ACCESS, vectors.parameters));

test("turns go on slot by slot as elfslam's do", () => {
  for (const { parameters, slots } of vectors.schedules) {
    let schedule = initialSchedule(parameters);
    slots.forEach(({ draw, others, wanted }, slot) => {
      const played = isPlayed(schedule, slot, draw[0], parameters);
      assert.equal(played, wanted.played, `slot ${slot}`);
      schedule = afterSlot(schedule, slot, others, played, draw[1], parameters);
      assert.deepEqual(schedule.mine, wanted.mine, `slot ${slot}`);
      assert.deepEqual(schedule.quiet, wanted.quiet);
      assert.deepEqual(schedule.sure, wanted.sure);
      assert.equal(schedule.alone, wanted.alone);
      assert.ok(Math.abs(schedule.shiftS - wanted.shift_s) < 1e-12);
    });
  }
});

test("others are heard in the slots where elfslam hears them", () => {
  const bytes = readFileSync(vectors.envelope);
  const envelope = new Float32Array(bytes.buffer, bytes.byteOffset, bytes.length / 4);
  let listening = NOTHING_HEARD;
  let heard = 0;
  for (const { first, last, slot, wanted } of vectors.slots) {
    const found = hearSlot(listening, envelope.subarray(first, last), first, slot, vectors.parameters);
    assert.deepEqual(found.others, wanted);
    listening = found.listening;
    heard += wanted.length;
  }
  assert.ok(heard > 10);
});

const floatsOf = (bytes) => new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
const spoilt = vectors.spoiled;
const spoiltSound = floatsOf(readFileSync(spoilt.envelope));
const envelope = (from, to) => Float32Array.from({ length: to - from }, (_, k) => spoiltSound[from + k] ?? 0);

test("frames are spoiled that elfslam says are", () => {
  const { arrivals, wanted } = spoilt;
  const looked = arrivals.map((sample, k) => lookAt(envelope, sample, arrivals[k - 1] ?? null, MEDIUM_ACCESS));
  const found = looked.map((frame, k) => isSpoiled(looked.slice(0, k), frame, looked.slice(k + 1), MEDIUM_ACCESS));
  assert.deepEqual(found, wanted);
  assert.ok(wanted.filter(Boolean).length > 5 && wanted.filter((each) => !each).length > 20);
});

/** The echoes that are let through as sound comes in, and when. */
function letThrough(isAmongOthers, block = 1000) {
  let end = 0;
  const heard = { envelope, end: () => end, sampleAt: (tS) => Math.round(tS * 44100) };
  const spoiled = makeSpoiled(heard, MEDIUM_ACCESS);
  const echoes = spoilt.arrivals.map((sample) => ({ tS: sample / 44100 }));
  const out = [];
  for (let given = 0; end < spoiltSound.length + 44100; ) {
    end += block;
    const from = given;
    while (given < echoes.length && spoilt.arrivals[given] + 2837 <= end) given += 1;
    out.push(...spoiled.take(echoes.slice(from, given), isAmongOthers).map(({ tS }) => ({ tS, waitedS: end / 44100 - tS })));
  }
  return out;
}

test("among others spoiled echoes are dropped as sound comes in, and none waits for long", () => {
  const clean = spoilt.arrivals.filter((_, k) => !spoilt.wanted[k]).map((sample) => sample / 44100);
  for (const block of [256, 1000, 9000]) assert.deepEqual(letThrough(true, block).map(({ tS }) => tS), clean);
  assert.ok(letThrough(true).every(({ waitedS }) => waitedS < 0.6));
});

test("alone no echo waits", () => {
  const out = letThrough(false);
  assert.deepEqual(out.map(({ tS }) => tS), spoilt.arrivals.map((sample) => sample / 44100));
  assert.ok(out.every(({ waitedS }) => waitedS < 0.09));
});

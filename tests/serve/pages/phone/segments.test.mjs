// The segments of a walk: paused, gone on with, ended, whatever happens at once.

import assert from "node:assert/strict";
import { test } from "node:test";

import { goesOnAt, makeSegments, mayGoOn } from "../../../../src/elfslam/serve/pages/phone/walking.js";

const BEGUN = "2026-01-01T10:00:00.000Z";
const begunMs = Date.parse(BEGUN);

/** A walk of which so much is kept. */
function walkOf(seconds, isOver = false) {
  return { startUtc: BEGUN, isOver, facts: { seconds, gaps: [] } };
}

/** Segments whose recorder and clock are planted, and what happened to them in its order. */
function planted(state, nowS = 0) {
  const clock = { nowS };
  const told = [];
  const segments = makeSegments(state, {
    begin: async (fromS) => {
      told.push(`begin ${fromS}`);
      if (clock.refuses) throw new Error("taken");
      return {
        pause: async () => {
          await new Promise((resolve) => setTimeout(resolve, 5));
          told.push("paused");
        },
        flush: async () => told.push("flushed"),
      };
    },
    close: async () => told.push("closed"),
    nowMs: () => begunMs + 1000 * clock.nowS,
  });
  return { segments, told, clock };
}

test("a walk goes on where the clock stands, and never before what is kept", () => {
  assert.equal(goesOnAt(walkOf(30), begunMs + 42_000), 42);
  assert.equal(goesOnAt(walkOf(30), begunMs + 30_200), 31);
  assert.equal(goesOnAt(walkOf(30), begunMs - 5000), 31);
});

test("a walk may go on for ten minutes, and not once it is over", () => {
  assert.ok(mayGoOn(walkOf(30), begunMs + 42_000));
  assert.ok(!mayGoOn(walkOf(30), begunMs + 700_000));
  assert.ok(!mayGoOn(walkOf(30, true), begunMs + 42_000));
});

test("a new walk begins at nought, and goes on behind its pause", async () => {
  const state = walkOf(0);
  const { segments, told, clock } = planted(state);
  await segments.goOn();
  assert.ok(segments.isGoing());
  state.facts.seconds = 20;
  await segments.pause();
  assert.ok(!segments.isGoing());
  clock.nowS = 26;
  await segments.goOn();
  assert.deepEqual(told, ["begin 0", "paused", "begin 26"]);
  assert.deepEqual(state.facts.gaps, [{ t_s: 20, lost_s: 6 }]);
  await segments.end();
  assert.deepEqual(told.slice(3), ["paused", "closed"]);
});

test("a walk that a reload broke off goes on behind what it kept", async () => {
  const { segments, told } = planted(walkOf(30), 45);
  await segments.goOn();
  assert.deepEqual(told, ["begin 45"]);
});

test("events at once take their turns, and none is done twice", async () => {
  const { segments, told, clock } = planted(walkOf(0));
  await Promise.all([segments.goOn(), segments.goOn(), segments.pause(), segments.pause()]);
  clock.nowS = 9;
  await Promise.all([segments.goOn(), segments.end(), segments.end(), segments.goOn()]);
  assert.deepEqual(told, ["begin 0", "paused", "begin 9", "paused", "closed"]);
  assert.ok(!segments.isGoing());
});

test("a microphone that is still taken leaves the walk as it was, to be tried again", async () => {
  const state = walkOf(12);
  const { segments, told, clock } = planted(state, 20);
  clock.refuses = true;
  await assert.rejects(segments.goOn(), /taken/);
  assert.ok(!segments.isGoing());
  assert.deepEqual(state.facts.gaps, []);
  clock.refuses = false;
  await segments.goOn();
  assert.ok(segments.isGoing());
  await segments.flush();
  await segments.end();
  assert.deepEqual(told, ["begin 20", "begin 20", "flushed", "paused", "closed"]);
});

test("what ends while it is paused is closed all the same", async () => {
  const { segments, told } = planted(walkOf(0));
  await segments.goOn();
  await segments.pause();
  await segments.flush();
  await segments.end();
  assert.deepEqual(told, ["begin 0", "paused", "closed"]);
});

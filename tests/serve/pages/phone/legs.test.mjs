// The legs of a walk: paused, gone on with, ended, whatever happens at once.

import assert from "node:assert/strict";
import { test } from "node:test";

import { goesOnAt, makeLegs, mayGoOn } from "../../../../src/elfslam/serve/pages/phone/legs.js";

const BEGUN = "2026-01-01T10:00:00.000Z";
const begunMs = Date.parse(BEGUN);

/** A walk of which so much is kept. */
function walkOf(seconds, isOver = false) {
  return { startUtc: BEGUN, isOver, facts: { seconds, gaps: [] } };
}

/** Legs whose recorder and clock are planted, and what happened to them in its order. */
function planted(state, nowS = 0) {
  const clock = { nowS };
  const told = [];
  const legs = makeLegs(state, {
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
  return { legs, told, clock };
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
  const { legs, told, clock } = planted(state);
  await legs.goOn();
  assert.ok(legs.isGoing());
  state.facts.seconds = 20;
  await legs.pause();
  assert.ok(!legs.isGoing());
  clock.nowS = 26;
  await legs.goOn();
  assert.deepEqual(told, ["begin 0", "paused", "begin 26"]);
  assert.deepEqual(state.facts.gaps, [{ t_s: 20, lost_s: 6 }]);
  await legs.end();
  assert.deepEqual(told.slice(3), ["paused", "closed"]);
});

test("a walk that a reload broke off goes on behind what it kept", async () => {
  const { legs, told } = planted(walkOf(30), 45);
  await legs.goOn();
  assert.deepEqual(told, ["begin 45"]);
});

test("events at once take their turns, and none is done twice", async () => {
  const { legs, told, clock } = planted(walkOf(0));
  await Promise.all([legs.goOn(), legs.goOn(), legs.pause(), legs.pause()]);
  clock.nowS = 9;
  await Promise.all([legs.goOn(), legs.end(), legs.end(), legs.goOn()]);
  assert.deepEqual(told, ["begin 0", "paused", "begin 9", "paused", "closed"]);
  assert.ok(!legs.isGoing());
});

test("a microphone that is still taken leaves the walk as it was, to be tried again", async () => {
  const state = walkOf(12);
  const { legs, told, clock } = planted(state, 20);
  clock.refuses = true;
  await assert.rejects(legs.goOn(), /taken/);
  assert.ok(!legs.isGoing());
  assert.deepEqual(state.facts.gaps, []);
  clock.refuses = false;
  await legs.goOn();
  assert.ok(legs.isGoing());
  await legs.flush();
  await legs.end();
  assert.deepEqual(told, ["begin 20", "begin 20", "flushed", "paused", "closed"]);
});

test("what ends while it is paused is closed all the same", async () => {
  const { legs, told } = planted(walkOf(0));
  await legs.goOn();
  await legs.pause();
  await legs.flush();
  await legs.end();
  assert.deepEqual(told, ["begin 0", "paused", "closed"]);
});

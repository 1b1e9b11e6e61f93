// Turns and listening in the page against elfslam.line.turns: vectors come from test_line_turns.py.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { NOTHING_HEARD, hearSlot } from "../../../../src/elfslam/serve/pages/line/listening.js";
import { TURNS, afterSlot, isPlayed, noTurns } from "../../../../src/elfslam/serve/pages/line/turns.js";

const vectors = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS, "utf8"));

test("the parameters are elfslam's", () => assert.deepEqual(TURNS, vectors.parameters));

test("turns go on slot by slot as elfslam's do", () => {
  for (const { parameters, slots } of vectors.turns) {
    let turns = noTurns(parameters);
    slots.forEach(({ draw, others, wanted }, slot) => {
      const played = isPlayed(turns, slot, draw[0], parameters);
      assert.equal(played, wanted.played, `slot ${slot}`);
      turns = afterSlot(turns, slot, others, played, draw[1], parameters);
      assert.deepEqual(turns.mine, wanted.mine, `slot ${slot}`);
      assert.deepEqual(turns.quiet, wanted.quiet);
      assert.deepEqual(turns.sure, wanted.sure);
      assert.equal(turns.alone, wanted.alone);
      assert.ok(Math.abs(turns.shiftS - wanted.shift_s) < 1e-12);
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

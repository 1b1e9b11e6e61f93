// The page judges what it hears as the line does, frame by frame.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { loudnessOf, makeSpoofingCheck, REASONS } from "../../../../src/elfslam/serve/pages/stages/spoofing.js";

const folder = process.env.ELFSLAM_VECTORS;
const { parameters, reasons, frames, echoes, endsS, found, clean, foundClean, some } = JSON.parse(
  readFileSync(join(folder, "spoofing.json"), "utf8"),
);
const bytes = readFileSync(join(folder, "samples.f32"));
const all = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength));
const samplesOf = (row) => all.subarray(2352 * row, 2352 * (row + 1));
const facts = frames.map((each) => ({ ...each, lateS: each.lateS ?? NaN }));
const heard = echoes.map(({ tS }, row) => ({ tS, samples: samplesOf(row) }));

test("the words are the line's", () => assert.deepEqual(REASONS, reasons));

test("loudness is the line's", () => {
  for (const { row, loud } of some) {
    loudnessOf(samplesOf(row)).forEach((value, part) => assert.ok(Math.abs(value - loud[part]) < 1e-6));
  }
});

test("all at once and frame by frame: the reasons are the line's", () => {
  const live = makeSpoofingCheck(parameters);
  let [frame, echo] = [0, 0];
  const reasonsLive = endsS.map((endS) => {
    for (; frame < facts.length && facts[frame].dueS < endS; frame += 1) {
      const until = facts[frame].dueS + 0.05;
      const from = echo;
      while (echo < heard.length && heard[echo].tS < until) echo += 1;
      live.take([facts[frame]], heard.slice(from, echo));
    }
    return live.reasonAt(endS);
  });
  assert.deepEqual(reasonsLive, found);
  const whole = makeSpoofingCheck(parameters);
  whole.take(facts, heard);
  assert.deepEqual(endsS.map(whole.reasonAt), found);
});

test("maps of before there was a rule of loudness, and pages that do not say it, are judged without", () => {
  const { compared_chirps, lag, lag_errors, ...older } = parameters;
  const unknown = facts.map(({ gainDb, ...each }) => each);
  for (const [known, told] of [[older, facts], [parameters, unknown]]) {
    const judge = makeSpoofingCheck(known);
    judge.take(told, heard);
    assert.deepEqual(endsS.map(judge.reasonAt).filter((reason) => reason === REASONS.length - 1), []);
  }
});

test("loudness is compared among clean echoes alone, however late they are known", () => {
  const isClean = new Set(clean);
  for (const late of [0, 2]) {
    const live = makeSpoofingCheck(parameters);
    heard.forEach((echo, row) => {
      const known = isClean.has(row - late) ? [heard[row - late]] : [];
      live.take([], [echo], known);
    });
    live.take(facts, [], heard.slice(heard.length - late).filter((_, k) => isClean.has(heard.length - late + k)));
    assert.deepEqual(endsS.map(live.reasonAt), foundClean);
  }
});

// Chirps that are played by a schedule: planted ones, and a simulated walk against elfslam.stages.echo, on
// the vectors of test_line_modules.py.

import assert from "node:assert/strict";
import { readdirSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { makeChirp } from "../../../../src/elfslam/serve/pages/stages/chirp.js";
import { makeEchoCutter } from "../../../../src/elfslam/serve/pages/stages/echo.js";
import { assertNear, assertSameFacts, cutAll, floats, heardAll, makeRandom, plantedSound, told } from "./vectors.mjs";

const SCENES = readdirSync(process.env.ELFSLAM_VECTORS).map((name) => join(process.env.ELFSLAM_VECTORS, name));
const WORKLET_BLOCK = 1024;

/** Chirps at random within each period, heard `lateS` after they are played. */
function scheduledSound(chirp, rateHz, count, lateS) {
  const random = makeRandom(7);
  const playedS = Array.from({ length: count }, (_, k) => 0.5 + 0.1 * k + 0.025 * random());
  const directS = playedS.map((tS, k) => tS + lateS(k));
  return { sound: plantedSound(chirp, rateHz, directS, directS[count - 1] + 1.2), playedS, directS };
}

function cutByPlan({ parameters, rateHz, chirp, sound, playedS, block = WORKLET_BLOCK }) {
  const live = makeEchoCutter({ rateHz, chirp, parameters });
  playedS.forEach((tS) => live.played(tS));
  return cutAll(live, sound, block);
}

for (const folder of SCENES) {
  const { rate_hz: rateHz } = told(folder, "stages.json");
  const { parameters } = told(folder, "map.json");
  const chirp = makeChirp(parameters.chirp, rateHz);
  const planned = (count, lateS) => ({ parameters, rateHz, chirp, ...scheduledSound(chirp, rateHz, count, lateS) });

  test(`a scheduled walk at ${rateHz} Hz is cut and told of as in Python`, () => {
    const plan = told(folder, "stages.json").scheduled;
    const live = makeEchoCutter({ rateHz, chirp, parameters });
    plan.played_s.forEach((tS, k) => live.played(tS, plan.gain_db[k]));
    const { echoes, frames } = heardAll(live, floats(folder, "scheduled"));
    const wanted = plan.arrivals.slice(0, echoes.length);
    assert.ok(plan.arrivals.length - wanted.length <= 1);
    assert.deepEqual(echoes.map((echo) => Math.round(echo.tS * 44100)), wanted);
    assertSameFacts(frames, plan.facts.slice(0, frames.length), 20 / 44100);
    assert.deepEqual(frames.map(({ gainDb }) => gainDb), plan.gain_db.slice(0, frames.length));
    assert.ok(plan.facts.length - frames.length < 8);
  });

  test(`chirps of a schedule at ${rateHz} Hz are found, however late they are heard`, () => {
    for (const late of [0.012, 0.23, 0.74]) {
      const plan = planned(30, () => late);
      const echoes = cutByPlan(plan);
      assertNear(echoes.map(({ tS }) => tS), plan.directS, 1.5 / 44100, `late by ${late}`);
    }
  });

  test(`at ${rateHz} Hz a schedule that jumps is found again, and no echo is lost`, () => {
    const plan = planned(60, (k) => (k < 30 ? 0.21 : 0.28));
    const echoes = cutByPlan(plan);
    assertNear(echoes.map(({ tS }) => tS), plan.directS, 1.5 / 44100, "arrivals");
    const jumps = echoes.map(({ facts }, k) => [k, facts.jumpedS]).filter(([, jumpedS]) => jumpedS !== 0);
    assert.deepEqual(jumps.map(([k]) => k), [30]);
    assertNear([jumps[0][1]], [0.07], 0.002, "jump");
  });

  test(`at ${rateHz} Hz somebody else's regular chirps are not taken for those of the schedule`, () => {
    const plan = planned(40, () => 0.2);
    for (let at = 0.53 * rateHz; at + chirp.length < plan.sound.length; at += 0.1 * rateHz) {
      chirp.forEach((value, n) => {
        plan.sound[Math.round(at) + n] += 0.15 * value;
      });
    }
    const echoes = cutByPlan(plan);
    const near = echoes.filter(({ tS }) => plan.directS.some((direct) => Math.abs(direct - tS) < 1e-4));
    assert.ok(near.length >= 36 && near.length >= echoes.length - 2, `${near.length} of ${echoes.length}`);
  });

  test(`at ${rateHz} Hz a schedule may be told three seconds ahead, and with the sound under way`, () => {
    const plan = planned(70, () => 0.2);
    const live = makeEchoCutter({ rateHz, chirp, parameters });
    const echoes = [];
    for (let at = 0, next = 20; at < plan.sound.length; at += WORKLET_BLOCK) {
      const nowS = at / rateHz;
      for (; nowS > 1 && plan.playedS[next] < nowS + 3; next += 1) live.played(9 + plan.playedS[next]);
      echoes.push(...live.push(9 * rateHz + at, plan.sound.subarray(at, at + WORKLET_BLOCK)));
    }
    const found = plan.directS.map((direct) => echoes.filter(({ tS }) => Math.abs(tS - 9 - direct) < 1e-4).length);
    assert.ok(found.slice(20).every((count) => count === 1), found.join());
    assert.ok(found.every((count) => count <= 1) && echoes.length <= 72, found.join());
  });

  test(`cut in any blocks, scheduled echoes at ${rateHz} Hz are the same`, () => {
    const plan = planned(40, (k) => (k < 20 ? 0.21 : 0.28));
    const whole = cutByPlan({ ...plan, block: plan.sound.length });
    for (const block of [128, 4801]) assert.deepEqual(cutByPlan({ ...plan, block }), whole);
  });
}

// The page's way from sound to echoes against elfslam.line: vectors come from test_line_modules.py,
// which names their folder in ELFSLAM_VECTORS.

import assert from "node:assert/strict";
import { readdirSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { makeChirp } from "../../../../src/elfslam/serve/pages/line/chirp.js";
import { makeEchoCutter } from "../../../../src/elfslam/serve/pages/line/echo.js";
import { makeEnvelope } from "../../../../src/elfslam/serve/pages/line/echo_envelope.js";
import { makeResampler } from "../../../../src/elfslam/serve/pages/line/resample.js";
import { assertNear, concatenated, cutAll, floats, streamed, told } from "./vectors.mjs";

const SCENES = readdirSync(process.env.ELFSLAM_VECTORS).map((name) => join(process.env.ELFSLAM_VECTORS, name));
const WORKLET_BLOCK = 1024;

for (const folder of SCENES) {
  const { rate_hz: rateHz, t_s: tS, arrivals } = told(folder, "stages.json");
  const { parameters } = told(folder, "map.json");
  const sound = floats(folder, "sound");
  const chirp = makeChirp(parameters.chirp, rateHz);
  const cutter = () => makeEchoCutter({ rateHz, chirp, parameters });

  test(`the chirp at ${rateHz} Hz is Python's`, () => {
    assertNear(chirp, floats(folder, "chirp"), 1e-6, "chirp");
  });

  test(`sound at ${rateHz} Hz comes to 44.1 kHz as in Python`, () => {
    const resampled = streamed(makeResampler(rateHz), sound, WORKLET_BLOCK);
    assertNear(resampled, floats(folder, "resampled"), 1e-6, "resampled");
  });

  test(`the envelope of sound at ${rateHz} Hz is Python's`, () => {
    const resampled = floats(folder, "resampled");
    const envelope = streamed(makeEnvelope(chirp, rateHz), resampled, WORKLET_BLOCK);
    assertNear(envelope, floats(folder, "envelope"), 2e-6, "envelope");
  });

  test(`echoes at ${rateHz} Hz are found and cut as in Python`, () => {
    const echoes = cutAll(cutter(), sound, WORKLET_BLOCK);
    assert.deepEqual(
      echoes.map((echo) => Math.round(echo.tS * 44100)),
      arrivals.slice(0, tS.length),
      "direct arrivals",
    );
    assertNear(echoes.map((echo) => echo.tS), tS, 1e-9, "times");
    assertNear(concatenated(echoes.map(({ samples }) => samples)), floats(folder, "traces"), 1e-6, "traces");
    const envelope = floats(folder, "envelope");
    assertNear(echoes.map((echo) => echo.directLevel), arrivals.slice(0, tS.length).map((k) => envelope[k]), 2e-6, "level");
  });

  test(`cut in any blocks, echoes at ${rateHz} Hz are the same to the last bit`, () => {
    const some = sound.subarray(0, 5 * rateHz);
    const whole = cutAll(cutter(), some, some.length);
    assert.ok(whole.length > 40);
    for (const block of [128, 700, WORKLET_BLOCK, 4801]) {
      assert.deepEqual(cutAll(cutter(), some, block), whole, `blocks of ${block}`);
    }
  });

  test(`an echo at ${rateHz} Hz is there 70 ms after its direct sound`, () => {
    const live = cutter();
    for (let at = 0; at < 5 * rateHz; at += 128) {
      for (const { tS: directS } of live.push(at, sound.subarray(at, at + 128))) {
        if (at > rateHz / 2) assert.ok((at + 128) / rateHz - directS < 0.07, `${at / rateHz - directS}`);
      }
    }
  });

  test(`what the browser lost at ${rateHz} Hz is silence, and the clock goes on`, () => {
    const live = cutter();
    const [lostFrom, lostTo] = [2 * rateHz, 2.34 * rateHz];
    const echoes = [
      ...live.push(7000, sound.subarray(0, lostFrom)),
      ...live.push(7000 + lostTo, sound.subarray(lostTo, 5 * rateHz)),
      ...live.end(),
    ];
    const startS = 7000 / rateHz;
    const near = tS.filter((t) => t < 1.9 || (t > 2.4 && t < 4.93)).map((t) => t + startS);
    const kept = echoes.map((echo) => echo.tS).filter((t) => t < 1.9 + startS || t > 2.4 + startS);
    assertNear(kept, near, 1e-9, "times around the gap");
    assert.ok(echoes.every(({ samples }) => samples.some((value) => value !== 0)));
  });
}

test("nothing is found in noise, and chirps are once they come", () => {
  const [folder] = SCENES;
  const { rate_hz: rateHz } = told(folder, "stages.json");
  const { parameters } = told(folder, "map.json");
  const chirp = makeChirp(parameters.chirp, rateHz);
  const sound = floats(folder, "sound").subarray(0, 4 * rateHz);
  let state = 1;
  const noise = Float32Array.from({ length: 3 * rateHz }, () => {
    state = (16807 * state) % 2147483647;
    return 0.01 * (state / 2147483647 - 0.5);
  });
  const live = makeEchoCutter({ rateHz, chirp, parameters });
  assert.deepEqual(live.push(0, noise), []);
  const echoes = live.push(noise.length, sound);
  assert.ok(echoes.length > 35, `${echoes.length} echoes`);
  assert.ok(echoes.every(({ tS }) => tS >= 3));
});

/** Chirps at random within each period, an echo behind each, noise; heard `lateS` after they are played. */
function scheduledSound(chirp, rateHz, count, lateS) {
  let state = 7;
  const random = () => {
    state = (16807 * state) % 2147483647;
    return state / 2147483647;
  };
  const playedS = Array.from({ length: count }, (_, k) => 0.5 + 0.1 * k + 0.025 * random());
  const sound = Float32Array.from({ length: (0.6 + 0.1 * count + 1.2) * rateHz }, () => 2e-4 * (random() - 0.5));
  const directS = playedS.map((tS, k) => tS + lateS(k));
  for (const tS of directS) {
    for (const [delayS, gain] of [[0, 0.2], [0.013, 0.05], [0.031, 0.03]]) {
      const at = Math.round((tS + delayS) * rateHz);
      chirp.forEach((value, n) => {
        sound[at + n] += gain * value;
      });
    }
  }
  return { sound, playedS, directS };
}

function cutByPlan({ parameters, rateHz, chirp, sound, playedS, block = WORKLET_BLOCK }) {
  const live = makeEchoCutter({ rateHz, chirp, parameters });
  playedS.forEach(live.played);
  return cutAll(live, sound, block);
}

for (const folder of SCENES) {
  const { rate_hz: rateHz } = told(folder, "stages.json");
  const parameters = { ...told(folder, "map.json").parameters };
  parameters.echo = { latest_s: 1, ...parameters.echo };
  const chirp = makeChirp(parameters.chirp, rateHz);
  const planned = (count, lateS) => ({ parameters, rateHz, chirp, ...scheduledSound(chirp, rateHz, count, lateS) });

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

  test(`cut in any blocks, scheduled echoes at ${rateHz} Hz are the same`, () => {
    const plan = planned(40, (k) => (k < 20 ? 0.21 : 0.28));
    const whole = cutByPlan({ ...plan, block: plan.sound.length });
    for (const block of [128, 4801]) assert.deepEqual(cutByPlan({ ...plan, block }), whole);
  });
}

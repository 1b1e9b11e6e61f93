// The page's way from sound to echoes against elfslam.stages: vectors come from test_line_modules.py,
// which names their folder in ELFSLAM_VECTORS.

import assert from "node:assert/strict";
import { readdirSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { makeChirp } from "../../../../src/elfslam/serve/pages/stages/chirp.js";
import { makeEchoCutter } from "../../../../src/elfslam/serve/pages/stages/echo.js";
import { atEchoRate, makeEnvelope } from "../../../../src/elfslam/serve/pages/stages/matched_filter.js";
import { makeResampler } from "../../../../src/elfslam/serve/pages/stages/resample.js";
import { assertNear, assertSameFacts, concatenated, cutAll, floats, heardAll, makeRandom, plantedSound, streamed, told } from "./vectors.mjs";

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
    const envelope = streamed(makeEnvelope(atEchoRate(chirp, rateHz)), resampled, WORKLET_BLOCK);
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

  test(`what is heard around chirps at ${rateHz} Hz is as Python says`, () => {
    const { echoes, frames } = heardAll(cutter(), sound);
    assert.ok(echoes.length > 100);
    const wanted = told(folder, "stages.json").facts;
    // Where the sound breaks off in the middle of a frame, Python does not ask for one more chirp.
    assert.ok(frames.length - wanted.length <= 1);
    assertSameFacts(frames.slice(0, wanted.length - 1), wanted.slice(0, -1), 1e-9);
  });

  test(`cut in any blocks, echoes at ${rateHz} Hz are the same to the last bit`, () => {
    const some = sound.subarray(0, 5 * rateHz);
    const whole = cutAll(cutter(), some, some.length);
    assert.ok(whole.length > 40);
    for (const block of [128, 4801]) {
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

for (const folder of SCENES) {
  const { rate_hz: rateHz } = told(folder, "stages.json");
  const { parameters } = told(folder, "map.json");
  const chirp = makeChirp(parameters.chirp, rateHz);
  const heard = (sound) => heardAll(makeEchoCutter({ rateHz, chirp, parameters }), sound);

  test(`how late chirps come at ${rateHz} Hz, that they jump or are missed, is told`, () => {
    const lateS = (k) => (k % 2 ? 0.001 : 0) + (k < 20 ? 0 : 0.03);
    const directS = Array.from({ length: 40 }, (_, k) => 0.3 + 0.1 * k + lateS(k)).filter((_, k) => k !== 9);
    const { echoes, frames } = heard(plantedSound(chirp, rateHz, directS, 4.6));
    assertNear(echoes.map(({ tS }) => tS), directS, 1.5 / 44100, "arrivals");
    const isMissed = frames.slice(0, 40).map((frame) => Number.isNaN(frame.lateS));
    assert.deepEqual(isMissed, isMissed.map((_, k) => k === 9));
    assertNear([frames[9].dueS], [1.2], 2 / 44100, "when the missed one was due");
    assertNear(frames.slice(1, 9).map((frame) => frame.lateS), [1, -1, 1, -1, 1, -1, 1, -1].map((ms) => ms / 1000), 2 / 44100, "late");
    const jumps = echoes.map(({ facts }) => facts.jumpedS).map((jumpedS, k) => [k, jumpedS]).filter(([, jumpedS]) => jumpedS !== 0);
    assert.deepEqual(jumps.map(([k]) => k), [19]);
    assertNear([jumps[0][1]], [0.029], 2 / 44100, "jump");
    assert.ok(frames[9].level < 0.01 * frames[8].level);
  });

  test(`chirps at ${rateHz} Hz that become softer for good are found again`, () => {
    const directS = Array.from({ length: 100 }, (_, k) => 0.3 + 0.1 * k);
    const sound = plantedSound(chirp, rateHz, directS, 10.6, (k) => (k < 50 ? 0.4 : 0.08));
    const found = heard(sound).echoes.map(({ tS }) => tS);
    assert.ok(found.some((tS) => tS > 5.4 && tS < 8.5), `${found.slice(50)}`);
    assertNear(found.slice(-20), directS.slice(-20), 1.5 / 44100, "the last ones");
  });

  test(`an echo at ${rateHz} Hz of which nothing was recorded is none`, () => {
    const directS = Array.from({ length: 30 }, (_, k) => 0.3 + 0.1 * k);
    const sound = plantedSound(chirp, rateHz, directS, 3.5);
    sound.fill(0, Math.round(1.308 * rateHz), Math.round(1.39 * rateHz));
    const { echoes, frames } = heard(sound);
    assertNear(echoes.map(({ tS }) => tS), directS.filter((_, k) => k !== 10), 1.5 / 44100, "arrivals");
    assert.ok(Math.abs(frames[10].lateS) < 1e-3, `${frames[10].lateS}`);
  });
}

test("nothing is found in noise, and chirps are once they come", () => {
  const [folder] = SCENES;
  const { rate_hz: rateHz } = told(folder, "stages.json");
  const { parameters } = told(folder, "map.json");
  const chirp = makeChirp(parameters.chirp, rateHz);
  const sound = floats(folder, "sound").subarray(0, 4 * rateHz);
  const random = makeRandom(1);
  const noise = Float32Array.from({ length: 3 * rateHz }, () => 0.01 * (random() - 0.5));
  const live = makeEchoCutter({ rateHz, chirp, parameters });
  assert.deepEqual(live.push(0, noise), []);
  const echoes = live.push(noise.length, sound);
  assert.ok(echoes.length > 35, `${echoes.length} echoes`);
  assert.ok(echoes.every(({ tS }) => tS >= 3));
});

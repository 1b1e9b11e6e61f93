// Times a fix from 0.6 s of sound, stage by stage, in a worker of the page.

import { makeChirp } from "/stages/chirp.js";
import { makeEchoCutter } from "/stages/echo.js";
import { atEchoRate, makeEnvelope } from "/stages/matched_filter.js";
import { encoderFor, openEncoder } from "/stages/encoder.js";
import { checkedMap } from "/stages/floor_map.js";
import { fixOf, similarity, meanOf } from "/stages/locate.js";
import { makeResampler } from "/stages/resample.js";
import { answer, bytes, floats, floorMapIn, json } from "./given.js";

const WORKLET_BLOCK = 1024;

answer(async () => {
  const { rateHz, windowS, passes, livePasses } = await json("sound.json");
  const floorMap = checkedMap(await floorMapIn("map"));
  const sound = await floats("sound");
  const encoderBytes = await bytes("encoder.onnx");
  const opened = await timed(() => openEncoder(encoderBytes));
  const listener = encoderFor(floorMap, opened.value);
  const place = { floorMap, listener, rateHz };
  const first = (await oneWindow(place, sound, windowS, 1))[0];
  const [windows, live] = [[], []];
  for (let pass = 0; pass < passes; pass += 1) windows.push(...(await oneWindow(place, sound, windowS, Infinity)));
  for (let pass = 0; pass < livePasses; pass += 1) live.push(...(await whileItComes(place, sound)));
  return { runtimeMs: opened.ms, first, windows, live, inside: insideEchoes(place, sound, windowS) };
});

async function timed(work) {
  const start = performance.now();
  const value = await work();
  return { value, ms: performance.now() - start };
}

/** Fixes of one window of sound after the other, each pushed at once. */
async function oneWindow({ floorMap, listener, rateHz }, sound, windowS, most) {
  const cutter = cutterFor(floorMap, rateHz);
  const size = Math.round(windowS * rateHz);
  const out = [];
  for (let at = 0; at + size <= sound.length && out.length < most; at += size) {
    const start = performance.now();
    const echoes = cutter.push(at, sound.subarray(at, at + size));
    const cut = performance.now();
    if (echoes.length < 3) continue;
    const vectors = await listener.embed(tracesOf(echoes), echoes.length);
    const embedded = performance.now();
    const scores = similarity(meanOf(vectors, 0, echoes.length), floorMap);
    const compared = performance.now();
    const { status, xyM } = fixOf(scores, floorMap, floorMap.parameters.locate);
    const fixed = performance.now();
    const ms = [cut - start, embedded - cut, compared - embedded, fixed - compared, fixed - start];
    out.push({ ms, echoes: echoes.length, status, xyM });
  }
  return out;
}

/** The same while the sound comes in blocks: what is left to do behind the last block of a window. */
async function whileItComes({ floorMap, listener, rateHz }, sound) {
  const cutter = cutterFor(floorMap, rateHz);
  const afterLastMs = [];
  let vectors = new Float32Array(0);
  for (let at = 0; at + WORKLET_BLOCK <= sound.length; at += WORKLET_BLOCK) {
    const start = performance.now();
    const echoes = cutter.push(at, sound.subarray(at, at + WORKLET_BLOCK));
    if (echoes.length > 0) {
      const more = await listener.embed(tracesOf(echoes), echoes.length);
      vectors = Float32Array.of(...vectors, ...more).slice(-6 * 128);
      const count = vectors.length / 128;
      if (count === 6) fixOf(similarity(meanOf(vectors, 0, 6), floorMap), floorMap, floorMap.parameters.locate);
      if (count === 6) afterLastMs.push(performance.now() - start);
    }
  }
  return afterLastMs;
}

/** What cutting echoes consists of, each by itself. */
function insideEchoes({ floorMap, rateHz }, sound, windowS) {
  const size = Math.round(windowS * rateHz);
  const resampler = makeResampler(rateHz);
  const envelope = makeEnvelope(atEchoRate(makeChirp(floorMap.parameters.chirp, rateHz), rateHz));
  const out = [];
  for (let at = 0; at + size <= sound.length; at += size) {
    const start = performance.now();
    const resampled = resampler.push(sound.subarray(at, at + size));
    const middle = performance.now();
    envelope.push(resampled);
    out.push([middle - start, performance.now() - middle]);
  }
  return out;
}

function cutterFor({ parameters }, rateHz) {
  return makeEchoCutter({ rateHz, chirp: makeChirp(parameters.chirp, rateHz), parameters });
}

function tracesOf(echoes) {
  const traces = new Float32Array(echoes.length * echoes[0].samples.length);
  echoes.forEach(({ samples }, k) => traces.set(samples, k * samples.length));
  return traces;
}

// Locates whole recordings with the page's code, in a worker of the page.

import { makeChirp } from "/line/chirp.js";
import { makeEchoCutter } from "/line/echo.js";
import { openEncoder } from "/line/encoder.js";
import { encoderFor } from "/line/feature.js";
import { checkedMap } from "/line/floor_map.js";
import { locateOneShot } from "/line/locate.js";
import { answer, bytes, floats, floorMapIn, json } from "./given.js";

const WORKLET_BLOCK = 1024;

answer(async () => {
  const encoder = await openEncoder(await bytes("encoder.onnx"));
  const found = {};
  for (const { key, name, map, rateHz, atOnce } of await json("walks.json")) {
    const floorMap = checkedMap(await floorMapIn(map));
    found[key] = await located(floorMap, encoder, await floats(name), rateHz, atOnce ? Infinity : 1);
  }
  return found;
});

/** Fixes of a recording that comes in blocks; so many echoes are embedded together at the most. */
async function located(floorMap, encoder, sound, rateHz, together) {
  const listener = await encoderFor(floorMap, encoder);
  const { parameters } = floorMap;
  const cutter = makeEchoCutter({ rateHz, chirp: makeChirp(parameters.chirp, rateHz), parameters });
  const echoes = [];
  for (let at = 0; at < sound.length; at += WORKLET_BLOCK) {
    echoes.push(...cutter.push(at, sound.subarray(at, at + WORKLET_BLOCK)));
  }
  echoes.push(...cutter.end());
  const vectors = [];
  for (let at = 0; at < echoes.length; at += together) {
    const some = echoes.slice(at, at + together);
    vectors.push(...(await listener.embed(tracesOf(some), some.length)));
  }
  return locateOneShot(echoes.map(({ tS }) => tS), Float32Array.from(vectors), floorMap);
}

function tracesOf(echoes) {
  const traces = new Float32Array(echoes.length * echoes[0].samples.length);
  echoes.forEach(({ samples }, k) => traces.set(samples, k * samples.length));
  return traces;
}

// Locates whole recordings with the page's code, in a worker of the page.

import { makeChirp } from "/line/chirp.js";
import { makeEchoCutter } from "/line/echo.js";
import { encoderFor, openEncoder } from "/line/encoder.js";
import { checkedMap } from "/line/floor_map.js";
import { locateOneShot } from "/line/locate.js";
import { answer, bytes, floats, floorMapIn, json } from "./given.js";

const WORKLET_BLOCK = 1024;

answer(async () => {
  const encoder = await openEncoder(await bytes("encoder.onnx"));
  const found = {};
  for (const { name, map, rateHz } of await json("walks.json")) {
    const floorMap = checkedMap(await floorMapIn(map));
    found[name] = await located(floorMap, encoder, await floats(name), rateHz);
  }
  return found;
});

/** Fixes of a recording that comes in blocks. */
async function located(floorMap, encoder, sound, rateHz) {
  const listener = encoderFor(floorMap, encoder);
  const { parameters } = floorMap;
  const cutter = makeEchoCutter({ rateHz, chirp: makeChirp(parameters.chirp, rateHz), parameters });
  const echoes = [];
  for (let at = 0; at < sound.length; at += WORKLET_BLOCK) {
    echoes.push(...cutter.push(at, sound.subarray(at, at + WORKLET_BLOCK)));
  }
  echoes.push(...cutter.end());
  const vectors = [];
  for (const { samples } of echoes) vectors.push(...(await listener.embed(samples, 1)));
  return locateOneShot(echoes.map(({ tS }) => tS), Float32Array.from(vectors), floorMap);
}

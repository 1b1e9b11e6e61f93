// The encoder in the browser's runtime against onnxruntime in Python, on the vectors of
// test_line_modules.py.

import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";

import { ECHO_SAMPLES } from "../../../../src/elfslam/serve/pages/stages/constants.js";
import { encoderFor, makeMeanNormalisation, openEncoder } from "../../../../src/elfslam/serve/pages/stages/encoder.js";
import { assertNear, floats, floorMapIn, told } from "./vectors.mjs";

const SCENES = readdirSync(process.env.ELFSLAM_VECTORS).map((name) => join(process.env.ELFSLAM_VECTORS, name));
const bytes = new Uint8Array(readFileSync(join(SCENES[0], "encoder.onnx")));
const encoder = await openEncoder(bytes);
const rows = (traces) => Array.from({ length: traces.length / ECHO_SAMPLES }, (_, k) =>
  traces.subarray(k * ECHO_SAMPLES, (k + 1) * ECHO_SAMPLES));

for (const folder of SCENES) {
  const { rate_hz: rateHz, identity } = told(folder, "stages.json");
  const traces = floats(folder, "traces");
  const count = traces.length / ECHO_SAMPLES;

  test(`ELFs of echoes at ${rateHz} Hz are Python's`, async () => {
    assert.equal(encoder.identity, identity);
    assertNear(await encoder.embed(traces, count), floats(folder, "elf"), 1e-4, "ELF");
  });

  test(`one echo at ${rateHz} Hz alone is one in a batch`, async () => {
    const together = await encoder.embed(traces, count);
    for (const k of [0, 7, count - 1]) {
      const alone = await encoder.embed(rows(traces)[k], 1);
      assertNear(alone, together.subarray(128 * k, 128 * (k + 1)), 1e-5, `echo ${k}`);
    }
  });

  test(`what the echoes at ${rateHz} Hz have in common is taken away as in Python, whatever they come with`, () => {
    const [elf, heard] = [floats(folder, "elf"), floats(folder, "heard")];
    for (const together of [1, 7, count]) {
      const centred = makeMeanNormalisation();
      for (let k = 0; k < count; k += together) {
        const some = elf.subarray(128 * k, 128 * Math.min(k + together, count));
        assertNear(centred(some), heard.subarray(128 * k, 128 * k + some.length), 1e-5, `echoes from ${k}`);
      }
    }
  });
}

test("a map of another encoder is refused", () => {
  const floorMap = floorMapIn(SCENES[0]);
  assert.equal(encoderFor(floorMap, encoder), encoder);
  assert.throws(() => encoderFor({ ...floorMap, encoder: "0123456789abcdef" }, encoder), /fetch the map again/);
});

test("what is no encoder is refused in one line", async () => {
  for (const wrong of [new Uint8Array(0), Uint8Array.of(1, 2, 3), bytes.slice(0, 5000), new TextEncoder().encode("<html>")]) {
    await assert.rejects(openEncoder(wrong), /not a readable ONNX graph; fetch the map again/);
  }
  await assert.rejects(encoder.embed(new Float32Array(100), 1), /wanted 1 of 2352 samples/);
});

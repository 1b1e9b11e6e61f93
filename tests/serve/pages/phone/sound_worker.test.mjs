// What leaves the worker behind the microphone: frames of the chirp band, and numbers about them.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";
import { MessageChannel } from "node:worker_threads";

import { MEDIUM_ACCESS } from "../../../../src/elfslam/serve/pages/stages/constants.js";
import { CHIRP } from "../../../../src/elfslam/serve/pages/stages/chirp.js";
import { PATIENCE } from "../../../../src/elfslam/serve/pages/phone/framer.js";

const vectors = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS, "utf8"));
const RATE_HZ = 48000;
const BLOCK = 1024;
const FILES = { baseband: ["baseband.csv", "baseband.iq"], whole: ["frames.csv", "frames.wav"] };

const told = [];
globalThis.self = { postMessage: (message) => told.push(message) };
await import("../../../../src/elfslam/serve/pages/phone/sound.worker.js");
const source = new MessageChannel();
const store = new MessageChannel();
const kept = [];
store.port2.on("message", (message) => kept.push(message));
order({ do: "open", rateHz: RATE_HZ, chirp: CHIRP, source: source.port1, store: store.port1 });

function order(given) {
  globalThis.self.onmessage({ data: given });
}

/** Chirps, and somebody who speaks louder than they are. */
const heard = Float32Array.from(vectors[RATE_HZ].sound, (value, n) => {
  const voice = Math.sin(2 * Math.PI * 4 * (n / RATE_HZ)) ** 2;
  return value + 0.3 * voice * Math.sin((2 * Math.PI * 700 * n) / RATE_HZ);
});

function speak() {
  for (let first = 0; first < heard.length; first += BLOCK) {
    source.port1.onmessage({ data: { first, samples: heard.slice(first, first + BLOCK) } });
  }
}

const settled = () => new Promise((resolve) => setTimeout(resolve, 50));

/** All that is in a message, down to its plain values. */
function leaves(value) {
  if (value !== null && typeof value === "object" && !ArrayBuffer.isView(value)) {
    return Object.values(value).flatMap(leaves);
  }
  return [value];
}

function levelAt(samples, hz, rateHz) {
  let re = 0;
  let im = 0;
  samples.forEach((value, n) => {
    re += value * Math.cos((2 * Math.PI * hz * n) / rateHz);
    im += value * Math.sin((2 * Math.PI * hz * n) / rateHz);
  });
  return (2 * Math.hypot(re, im)) / samples.length;
}

test("of the probe nothing is kept, and numbers alone are told", async () => {
  order({ do: "listen" });
  speak();
  order({ do: "measure", due: 2064, count: 10 });
  await settled();
  assert.deepEqual(kept, []);
  assert.equal(told.length, 1);
  const values = leaves(told[0]);
  assert.ok(values.length < 40);
  assert.ok(values.every((value) => typeof value === "number" || value === "measured"));
});

test("what a microphone did not give is silence, at its place", async () => {
  told.length = 0;
  order({ do: "listen" });
  order({ do: "measure", due: 2064, count: 10 });
  const { measured: nothing } = told[0];
  assert.deepEqual([nothing.peak, nothing.heard, nothing.silentShare, nothing.echoDb], [0, 0, 1, null]);
  told.length = 0;
  order({ do: "listen" });
  for (let first = 0; first < heard.length; first += BLOCK) {
    if (first !== 20 * BLOCK) source.port1.onmessage({ data: { first, samples: heard.slice(first, first + BLOCK) } });
  }
  order({ do: "measure", due: 2064, count: 10 });
  assert.ok(told[0].measured.heard >= 9);
  assert.ok(told[0].measured.jitterS < 1e-4);
  await settled();
});

for (const kind of Object.keys(FILES)) {
  test(`of a walk (${kind}) frames alone are kept, without the voice`, async () => {
    told.length = 0;
    kept.length = 0;
    order({ do: "record", walk: "w", kind, mediumAccess: MEDIUM_ACCESS, latencyS: null });
    speak();
    order({ do: "stop" });
    speak();
    await settled();
    assert.ok(told.every((message) => leaves(message).every((value) => !ArrayBuffer.isView(value))));
    const frames = told.filter((message) => message.is === "frame").length;
    assert.ok(frames > 8 && frames <= heard.length / (0.1 * RATE_HZ) + PATIENCE);
    const parts = kept.flatMap((message) => message.parts);
    assert.deepEqual([...new Set(parts.map(([name]) => name))].sort(), FILES[kind]);
    const sound = parts.filter(([name, bytes]) => name === FILES[kind][1] && bytes.length > 44);
    assert.equal(sound.length, frames);
    if (kind === "whole") {
      const bytes = sound[3][1];
      const view = new DataView(bytes.buffer, bytes.byteOffset);
      const samples = Array.from({ length: bytes.length / 2 }, (_, k) => view.getInt16(2 * k, true) / 32767);
      assert.ok(levelAt(heard.subarray(20000, 23840), 700, RATE_HZ) > 0.01);
      assert.ok(levelAt(samples, 700, RATE_HZ) < 2e-6);
    }
  });
}

test("a walk that goes on adds to its files, from then on", async () => {
  told.length = 0;
  kept.length = 0;
  const sizes = { "baseband.csv": 400, "baseband.iq": 40320 };
  order({ do: "record", walk: "w", kind: "baseband", mediumAccess: MEDIUM_ACCESS, latencyS: null, fromS: 90, kept: sizes });
  speak();
  order({ do: "stop" });
  await settled();
  assert.equal(told.find((message) => message.is === "started").zero, -90 * RATE_HZ);
  const times = told.filter((message) => message.is === "frame").map(({ tS }) => tS);
  assert.ok(times.length > 8 && times.every((tS) => tS >= 90 && tS < 92), times.join(" "));
  const parts = kept.flatMap((message) => message.parts);
  const rows = parts.filter(([name]) => name === "baseband.csv").map(([, bytes]) => new TextDecoder().decode(bytes));
  assert.ok(rows.every((row) => /^9[01]\./.test(row)), "no header a second time");
  const stopped = told.find((message) => message.is === "stopped");
  assert.ok(Math.abs(stopped.seconds - 90 - heard.length / RATE_HZ) < 0.05);
  assert.equal(stopped.sizes["baseband.iq"], 40320 + 2016 * times.length);
  assert.equal(stopped.sizes["baseband.csv"], 400 + rows.join("").length);
});

test.after(() => {
  for (const port of [source.port1, source.port2, store.port1, store.port2]) port.close();
});

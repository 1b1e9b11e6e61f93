// Reads what line_vectors.py wrote.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";

/** @param {string} folder @param {string} name of a file of little-endian float32 */
export function floats(folder, name) {
  const bytes = readFileSync(join(folder, `${name}.f32`));
  return new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
}

export function told(folder, name) {
  return JSON.parse(readFileSync(join(folder, name), "utf8"));
}

/** The floor map of a folder, as the page has it. */
export function floorMapIn(folder) {
  const map = told(folder, "map.json");
  return {
    ...map,
    xyM: floats(folder, "xy"),
    headingRad: floats(folder, "heading"),
    covarianceM2: floats(folder, "covariance"),
    vectors: floats(folder, "vectors"),
  };
}

export function assertNear(got, wanted, tolerance, what) {
  assert.equal(got.length, wanted.length, `${what}: length`);
  for (let k = 0; k < got.length; k += 1) {
    assert.ok(Math.abs(got[k] - wanted[k]) <= tolerance, `${what}[${k}]: ${got[k]}, wanted ${wanted[k]}`);
  }
}

/** What comes out of something with `push` and `end`, for sound in blocks of some size. */
export function streamed({ push, end }, samples, block) {
  const parts = [];
  for (let at = 0; at < samples.length; at += block) parts.push(push(samples.subarray(at, at + block)));
  return concatenated([...parts, end()]);
}

export function concatenated(parts) {
  const out = new Float32Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    out.set(part, at);
    at += part.length;
  }
  return out;
}

/** The echoes of a cutter that hears sound in blocks of some size. */
export function cutAll(cutter, samples, block, first = 0) {
  const echoes = [];
  for (let at = 0; at < samples.length; at += block) {
    echoes.push(...cutter.push(first + at, samples.subarray(at, at + block)));
  }
  return [...echoes, ...cutter.end()];
}

const BLOCK = 1024;

/** The echoes of a cutter, and what it tells of the frames around them. */
export function heardAll(live, sound) {
  const [echoes, frames] = [[], []];
  for (let at = 0; at < sound.length; at += BLOCK) {
    echoes.push(...live.push(at, sound.subarray(at, at + BLOCK)));
    frames.push(...live.frames());
  }
  return { echoes: [...echoes, ...live.end()], frames: [...frames, ...live.frames()] };
}

/** Whether a chirp was heard, and what was heard around it; when it was due within `dueS`. */
export function assertSameFacts(frames, wanted, dueS) {
  const ofAll = (facts, name) => facts.map((each) => each[name]);
  assert.deepEqual(frames.map(({ lateS }) => Number.isNaN(lateS)), wanted.map(({ lateS }) => lateS === null));
  assertNear(ofAll(frames, "dueS"), ofAll(wanted, "dueS"), dueS, "dueS");
  const heard = (facts) => facts.filter((_, k) => wanted[k].lateS !== null);
  assertNear(ofAll(heard(frames), "lateS"), ofAll(heard(wanted), "lateS"), dueS, "lateS");
  for (const name of ["level", "noise", "clipped"]) assertNear(ofAll(frames, name), ofAll(wanted, name), 1e-5, name);
  assertNear(ofAll(frames, "before"), ofAll(wanted, "before"), 1e-4, "before");
}

/** Numbers in (0, 1), the same for the same seed. */
export function makeRandom(seed) {
  let state = seed;
  return () => {
    state = (16807 * state) % 2147483647;
    return state / 2147483647;
  };
}

/** Noise, and chirps with two echoes each whose direct sound comes at some times, as loud as `gainAt` says. */
export function plantedSound(chirp, rateHz, directS, durationS, gainAt = () => 0.2) {
  const random = makeRandom(11);
  const sound = Float32Array.from({ length: Math.round(durationS * rateHz) }, () => 2e-4 * (random() - 0.5));
  directS.forEach((tS, k) => {
    for (const [delayS, share] of [[0, 1], [0.013, 0.25], [0.031, 0.15]]) {
      const at = Math.round((tS + delayS) * rateHz);
      chirp.forEach((value, n) => {
        sound[at + n] += share * gainAt(k) * value;
      });
    }
  });
  return sound;
}

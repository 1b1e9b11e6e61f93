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
    phone: map.phone && Float32Array.from(map.phone),
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

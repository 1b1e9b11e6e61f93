// Embeds echoes with onnxruntime-web (WebAssembly, one thread) and times it.
//
//   node check.mjs ENCODER.onnx FOLDER COUNT...
//
// Reads FOLDER/samples.f32 (rows of 2352 float32), embeds the first COUNT rows at once for each
// COUNT, writes FOLDER/elf_COUNT.f32, and prints the milliseconds of the fastest run as JSON.

import { readFile, writeFile } from "node:fs/promises";
import { join } from "node:path";
import * as ort from "onnxruntime-web";

const ECHO_SAMPLES = 2352;
const REPEATS = 5;

const floats = (file) => new Float32Array(file.buffer, file.byteOffset, file.byteLength / 4);

async function embedded(session, samples, count) {
  const rows = samples.subarray(0, count * ECHO_SAMPLES);
  const { elf } = await session.run({
    samples: new ort.Tensor("float32", rows, [count, ECHO_SAMPLES]),
  });
  return elf.data;
}

async function fastestMs(work) {
  const ms = [];
  for (let k = 0; k < REPEATS; k += 1) {
    const start = performance.now();
    await work();
    ms.push(performance.now() - start);
  }
  return Math.min(...ms);
}

const [encoder, folder, ...counts] = process.argv.slice(2);
ort.env.wasm.numThreads = 1;
ort.env.logLevel = "error";
const options = { executionProviders: ["wasm"], logSeverityLevel: 3 };
const session = await ort.InferenceSession.create(await readFile(encoder), options);
const samples = floats(await readFile(join(folder, "samples.f32")));
const ms = {};
for (const count of counts.map(Number)) {
  const elf = await embedded(session, samples, count);
  await writeFile(join(folder, `elf_${count}.f32`), new Uint8Array(elf.buffer, elf.byteOffset, elf.byteLength));
  ms[count] = await fastestMs(() => embedded(session, samples, count));
}
console.log(JSON.stringify(ms));

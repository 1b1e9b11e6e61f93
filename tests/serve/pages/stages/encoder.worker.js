// The encoder in a worker of a browser: embeds the echoes that it is given, all at once and one alone.

import { openEncoder } from "/stages/encoder.js";

const given = async (name) => (await fetch(`/given/${name}`)).arrayBuffer();

async function embedded() {
  const encoder = await openEncoder(new Uint8Array(await given("encoder.onnx")));
  const traces = new Float32Array(await given("traces.f32"));
  const count = traces.length / 2352;
  const together = await encoder.embed(traces, count);
  const alone = await encoder.embed(traces.subarray(0, 2352), 1);
  return { identity: encoder.identity, together: [...together], alone: [...alone] };
}

embedded().then(
  (found) => self.postMessage(found),
  (error) => self.postMessage({ failed: `${error.message} ${error.stack}` }),
);

// What the benchmark hands to the page.

export async function json(name) {
  return (await fetch(`/benchmarks/data/${name}`)).json();
}

export async function floats(name) {
  return new Float32Array(await (await fetch(`/benchmarks/data/${name}.f32`)).arrayBuffer());
}

export async function bytes(name) {
  return new Uint8Array(await (await fetch(`/benchmarks/data/${name}`)).arrayBuffer());
}

/** The floor map of a folder, as the page has it. */
export async function floorMapIn(folder) {
  const map = await json(`${folder}/map.json`);
  const [xyM, headingRad, covarianceM2, vectors] = await Promise.all(
    ["xy", "heading", "covariance", "vectors"].map((name) => floats(`${folder}/${name}`)),
  );
  return { ...map, xyM, headingRad, covarianceM2, vectors };
}

/** Hands over what a worker has found, or why it did not. */
export function answer(work) {
  work().then(
    (found) => self.postMessage(found),
    (error) => self.postMessage({ failed: `${error.message} ${error.stack}` }),
  );
}

// The page's motion and growing map in node: `node live_footsteps.mjs VERB GIVEN.json` prints JSON.

import { readFileSync } from "node:fs";

import { makeFootsteps } from "../src/elfslam/serve/pages/stages/motion/live.js";
import { makeSketch } from "../src/elfslam/serve/pages/phone/growing/sketch.js";

const EVERY_S = 0.1;

/**
 * The live steps of a walk whose readings come one by one, asked for ten times a second.
 * @returns {{tS: number, fromS: number, moveM: number[], sigma: number[], takenS: number}[]}
 */
function liveSteps({ imu, parameters }) {
  const footsteps = makeFootsteps(parameters);
  const steps = [];
  let nextS = EVERY_S;
  imu.tS.forEach((tS, k) => {
    footsteps.push(tS, imu.accelMps2.slice(3 * k, 3 * k + 3), imu.gyroRadps.slice(3 * k, 3 * k + 3));
    if (tS < nextS) return;
    nextS = tS + EVERY_S;
    for (const step of footsteps.take(tS)) steps.push({ ...step, takenS: tS });
  });
  return steps;
}

/**
 * The map as it stands when the walk ends: when each footstep was, its pose, and how many loops closed. `heard` has
 * a time and a vector per echo.
 */
function sketchOf({ imu, motion, closure, heard, fewest }) {
  const sketch = makeSketch(closure);
  const steps = liveSteps({ imu, parameters: motion });
  for (const step of steps) {
    const between = heard.vectors.filter((_, k) => heard.tS[k] >= step.fromS && heard.tS[k] < step.tS);
    sketch.step(step, between.length < fewest ? null : meanOf(between));
  }
  const { poses, loops } = sketch.now();
  return { tS: [steps[0].fromS, ...steps.map(({ tS }) => tS)], poses: Array.from(poses), loops: loops.length };
}

/** @param {number[][]} vectors */
function meanOf(vectors) {
  return Float32Array.from(vectors[0], (_, n) => vectors.reduce((sum, each) => sum + each[n], 0) / vectors.length);
}

const [, , verb, file] = process.argv;
const VERBS = { sketch: sketchOf, steps: liveSteps };
process.stdout.write(JSON.stringify(VERBS[verb](JSON.parse(readFileSync(file)))));

/**
 * The page's motion and tracker at work: in node by `node page_tracking.mjs VERB GIVEN.json`, which prints
 * JSON, and in a browser by its functions.
 */

import { makeFootsteps } from "../../src/elfslam/serve/pages/line/motion/live.js";
import { makeTracker } from "../../src/elfslam/serve/pages/line/track.js";
import { makeRandom } from "../../src/elfslam/serve/pages/line/tracking/random.js";
import { makeSketch } from "../../src/elfslam/serve/pages/phone/growing/sketch.js";

const EVERY_S = 0.1;

/**
 * The live steps of a walk whose readings come one by one, asked for ten times a second.
 * @returns {{tS: number, fromS: number, moveM: number[], sigma: number[], takenS: number}[]}
 */
export function liveSteps({ imu, parameters }) {
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

/** The same, and processor milliseconds per time that steps were asked for. */
function timedSteps(given) {
  let steps = [];
  const spentMs = processorMs(() => {
    steps = liveSteps(given);
  });
  const { tS } = given.imu;
  return { steps, askMs: (spentMs * EVERY_S) / (tS[tS.length - 1] - tS[0]) };
}

/** Fixes at the end of each step, for each seed; `scores` has a row per step, or null. */
export function fixesOf({ map, steps, scores, parameters, seeds }) {
  const spots = asArrays(map);
  const rows = scores.map((row) => row && Float32Array.from(row));
  return seeds.map((seed) => {
    const tracker = makeTracker(spots, parameters, makeRandom(seed));
    return steps.map(({ moveM, sigma }, k) => tracker.step(moveM, sigma, rows[k]));
  });
}

function asArrays({ xyM, headingRad, covarianceM2 }) {
  return {
    xyM: Float32Array.from(xyM),
    headingRad: Float32Array.from(headingRad),
    covarianceM2: Float32Array.from(covarianceM2),
  };
}

/** Spots every 14 cm of a zigzag of corridors, there and back, and a walk along it. */
export function madeFloor(count) {
  const [aisleM, spacingM] = [30, 0.14];
  const map = { xyM: new Float32Array(2 * count), headingRad: new Float32Array(count), covarianceM2: new Float32Array(3 * count) };
  const random = makeRandom(1);
  for (let k = 0; k < count; k += 1) {
    const alongM = spacingM * (k >> 1);
    const aisle = Math.floor(alongM / aisleM);
    const back = (aisle + k) % 2;
    const withinM = alongM - aisle * aisleM;
    map.xyM[2 * k] = (aisle % 2 ? aisleM - withinM : withinM) + 0.1 * random.normal();
    map.xyM[2 * k + 1] = 3 * aisle + 0.1 * random.normal();
    map.headingRad[k] = back * Math.PI + 0.1 * random.normal();
    map.covarianceM2.set([0.02, 0, 0.02], 3 * k);
  }
  return map;
}

/** Scores as of a walker 0.7 m further along the zigzag at each step. */
export function madeScores(map, stepCount) {
  const random = makeRandom(2);
  return Array.from({ length: stepCount }, (_, step) => {
    const spot = (10 * step) % map.headingRad.length;
    return Float32Array.from(map.headingRad, (heading, k) => {
      const away = Math.hypot(map.xyM[2 * k] - map.xyM[2 * spot], map.xyM[2 * k + 1] - map.xyM[2 * spot + 1]);
      const alike = Math.exp(-(away ** 2) / 2) * (0.6 + 0.4 * Math.cos(heading - map.headingRad[spot]));
      return 0.5 + 0.4 * alike + 0.05 * random.normal();
    });
  });
}

/**
 * A floor of so many spots and a walk of so many steps down its first corridor: a function that makes a tracker,
 * which gives a function that takes the walk.
 */
export function walkerOn({ spots, parameters, steps }) {
  const map = madeFloor(spots);
  const scores = madeScores(map, steps);
  return () => {
    const tracker = makeTracker(map, parameters, makeRandom(3));
    return () => {
      const fixes = scores.map((row) => tracker.step([0.7, 0, 0], [0.2, 0.15, 0.01], row));
      const right = fixes.filter(({ status }) => status === "OK").length;
      if (right < 0.8 * steps) throw new Error(`the walk is lost: ${right} of ${steps} fixes are OK`);
    };
  };
}

/** Processor milliseconds of what is done, in node. */
function processorMs(work) {
  const before = process.cpuUsage();
  work();
  const { user, system } = process.cpuUsage(before);
  return (user + system) / 1000;
}

/** Milliseconds of the fastest of some rounds, per step. */
function costs({ imu, motion, track, spots, steps, rounds }) {
  const best = (work) => Math.min(...Array.from({ length: rounds }, () => processorMs(work)));
  const count = liveSteps({ imu, parameters: motion }).length;
  const told = { motion: best(() => liveSteps({ imu, parameters: motion })) / count };
  for (const many of spots) {
    const setOff = walkerOn({ spots: many, parameters: track, steps });
    const each = Array.from({ length: rounds + 1 }, () => processorMs(setOff()));
    told[many] = Math.min(...each) / steps;
    told[`tree of ${many}`] = best(setOff);
  }
  return told;
}

/** The map as it stands when the walk ends: when each footstep was, its pose, and how many loops closed. `heard` has
 * a time and a vector per echo. */
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

const VERBS = { sketch: sketchOf, steps: liveSteps, timed: timedSteps, fixes: fixesOf, costs };

if (typeof process !== "undefined" && process.argv[1]?.endsWith("page_tracking.mjs")) {
  const { readFileSync } = await import("node:fs");
  const [, , verb, file] = process.argv;
  process.stdout.write(JSON.stringify(VERBS[verb](JSON.parse(readFileSync(file)))));
}

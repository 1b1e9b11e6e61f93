// Times footsteps as a walk goes on, and the particle filter on a floor of many spots.

import { makeFootsteps } from "/stages/motion/live.js";
import { makeTracker } from "/stages/track.js";
import { makeRandom } from "/stages/particles.js";
import { answer, json } from "./given.js";

const EVERY_S = 0.1;

answer(async () => {
  const { imu, motion, track, spots, steps, rounds } = await json("walk.json");
  const fastestMs = (setOff) => Math.min(...Array.from({ length: rounds }, () => timedMs(setOff())));
  const told = { motion: fastestMs(() => () => liveSteps(imu, motion)) / liveSteps(imu, motion) };
  for (const many of spots) told[many] = fastestMs(walkerOn(many, track, steps)) / steps;
  return told;
});

function timedMs(work) {
  const start = performance.now();
  work();
  return performance.now() - start;
}

/** How many steps a walk has whose readings come one by one, asked for ten times a second. */
function liveSteps(imu, parameters) {
  const footsteps = makeFootsteps(parameters);
  let [count, nextS] = [0, EVERY_S];
  imu.tS.forEach((tS, k) => {
    footsteps.push(tS, imu.accelMps2.slice(3 * k, 3 * k + 3), imu.gyroRadps.slice(3 * k, 3 * k + 3));
    if (tS < nextS) return;
    nextS = tS + EVERY_S;
    count += footsteps.take(tS).length;
  });
  return count;
}

/** A floor and a walk down its first corridor: makes a tracker, and what takes the walk. */
function walkerOn(count, parameters, steps) {
  const map = madeFloor(count);
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

/** Spots every 14 cm of a zigzag of corridors, there and back. */
function madeFloor(count) {
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
function madeScores(map, stepCount) {
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

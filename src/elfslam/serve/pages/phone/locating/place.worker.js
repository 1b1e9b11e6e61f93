/**
 * The worker that locates. The audio thread sends it blocks of sound, the page readings of motion and when
 * chirps were played; it answers with fixes.
 */

import { makeChirp } from "../../line/chirp.js";
import { makeEchoCutter } from "../../line/echo.js";
import { encoderFor, openEncoder } from "../../line/encoder.js";
import { checkedMap } from "../../line/floor_map.js";
import { makeFootsteps } from "../../line/motion/live.js";
import { makeTracker } from "../../line/track.js";
import { makeSpoofingCheck } from "../../line/spoofing.js";
import { makeRandom } from "../../line/tracking/random.js";
import { decideBySteps, decideByWindows } from "./deciding.js";
import { makeMemory } from "./memory.js";
import { delayMotion } from "./motion_delay.js";
import { hearOthers } from "./others.js";
import { makePlacer } from "./placer.js";

/** Of the tracker's draws. */
const SEED = 0;

let motion = { push() {} };
let cutter = { played() {}, latenessS: () => null };
let others = { add() {}, take: () => [] };

const orders = {
  open: openMap,
  motion: ({ readings }) => motion.push(readings),
  slot({ slot }) {
    others.add(slot);
    if (slot.playedS === null) return;
    cutter.played(slot.playedS, slot.gainDb);
  },
};

self.onmessage = ({ data }) => orders[data.do](data);

async function openMap({ rateHz, floorMap, encoderBytes, mode, source }) {
  try {
    const placer = await placerFor(rateHz, checkedMap(floorMap), encoderBytes, mode);
    source.onmessage = ({ data }) => {
      placer.push(data.first, data.samples).catch(tellProblem);
      others.take().forEach((heard) => self.postMessage({ is: "heard", ...heard }));
    };
    self.postMessage({ is: "ready" });
  } catch (error) {
    tellProblem(error);
  }
}

async function placerFor(rateHz, floorMap, encoderBytes, mode) {
  const { parameters } = floorMap;
  const listener = encoderFor(floorMap, await openEncoder(encoderBytes, {}));
  cutter = makeEchoCutter({ rateHz, chirp: makeChirp(parameters.chirp, rateHz), parameters });
  others = hearOthers(cutter, parameters.chirp.period_s, parameters.medium_access);
  const memory = makeMemory(parameters.locate.fewest_echoes);
  const footsteps = makeFootsteps(parameters.motion);
  motion = delayMotion(footsteps, cutter.latenessS);
  const spoofing = makeSpoofingCheck(parameters.spoofing);
  const deciding = mode === "track"
    ? decideBySteps({ floorMap, memory, footsteps, spoofing, tracker: makeTracker(floorMap, parameters.track, makeRandom(SEED)) })
    : decideByWindows({ floorMap, memory, spoofing });
  return makePlacer({ rateHz, cutter, clean: others.clean, listener, spoofing, memory, deciding, onFix, onEcho });
}

function onFix(fix) {
  self.postMessage({ is: "fix", fix });
}

function onEcho({ tS, facts }) {
  self.postMessage({ is: "echo", tS, facts, latenessS: cutter.latenessS() });
}

function tellProblem(error) {
  self.postMessage({ is: "problem", said: error.message });
}

// The view "Where am I": words, ellipse, trail, list of maps, and fixes as sound and motion come in.

import assert from "node:assert/strict";
import { test } from "node:test";

import { decideBySteps, decideByWindows } from "../../../../src/elfslam/serve/pages/phone/locating/deciding.js";
import {
  SIGMAS, ellipseOf, placeSpoken, radiusOf, within, wordsOf,
} from "../../../../src/elfslam/serve/pages/phone/locating/words.js";
import { joins } from "../../../../src/elfslam/serve/pages/phone/locating/walked_ground.js";
import { makeFloors } from "../../../../src/elfslam/serve/pages/stages/floor_location.js";
import { thinned } from "../../../../src/elfslam/serve/pages/stages/ways.js";
import {
  LOST, NOTHING_NEAR, NO_POSITION, REFUSED, floorsNear, offersOf, questionOf, rowsOf, venuesOf,
} from "../../../../src/elfslam/serve/pages/phone/locating/choosing.js";
import { delayMotion, makeMemory, makePlacer } from "../../../../src/elfslam/serve/pages/stages/pipeline.js";
import { NO_TRAIL, withFix } from "../../../../src/elfslam/serve/pages/phone/locating/place_map.js";

const NB = "\u00a0";
const near = (actual, wanted, slack = 1e-9) => assert.ok(Math.abs(actual - wanted) <= slack, `${actual} is not ${wanted}`);
const fixAt = (x, y, status = "OK") => ({ tS: 1, xyM: [x, y], headingRad: 0, covarianceM2: [0.04, 0, 0.04], score: 0.9, status });
const nowhere = (status) => ({ tS: 1, xyM: null, headingRad: NaN, covarianceM2: null, score: 0.1, status });

test("two of three draws of a bell curve lie inside its ellipse", () => {
  const covariance = [0.5, 0.3, 0.4];
  const { majorM, minorM, turnRad } = ellipseOf(covariance);
  let inside = 0;
  let seed = 1;
  const uniform = () => (seed = (seed * 48271) % 2147483647) / 2147483647;
  const normal = () => Math.sqrt(-2 * Math.log(uniform())) * Math.cos(2 * Math.PI * uniform());
  const root = [Math.sqrt(0.5), 0.3 / Math.sqrt(0.5)];
  for (let k = 0; k < 6000; k += 1) {
    const [a, b] = [normal(), normal()];
    const [x, y] = [root[0] * a, root[1] * a + Math.sqrt(0.4 - root[1] ** 2) * b];
    const along = x * Math.cos(turnRad) + y * Math.sin(turnRad);
    const across = y * Math.cos(turnRad) - x * Math.sin(turnRad);
    inside += (along / majorM) ** 2 + (across / minorM) ** 2 <= 1 ? 1 : 0;
  }
  near(inside / 6000, 2 / 3, 0.02);
  near(radiusOf([0.04, 0, 0.04]), 0.2 * SIGMAS);
});

test("every status has its words, and those with a place say how sure it is", () => {
  assert.deepEqual(wordsOf(fixAt(1, 2)).title, `Here, within 0.3${NB}m`);
  assert.equal(wordsOf(fixAt(1, 2)).verdict, "pass");
  assert.match(wordsOf(fixAt(1, 2, "AMBIGUOUS")).line, /likeliest is shown, within 0.3/);
  assert.match(wordsOf(nowhere("UNKNOWN_PLACE")).line, /left it, or it has changed/);
  assert.match(wordsOf(nowhere("NO_ECHO")).line, /^Is the loudspeaker covered/);
  assert.match(wordsOf(fixAt(1, 2, "NO_ECHO")).line, /^Counting steps/);
  const suspect = wordsOf({ ...nowhere("SUSPECT"), reason: "a chirp was heard before it was played" });
  assert.equal(suspect.line, "A chirp was heard before it was played.");
  assert.equal(suspect.verdict, "fail");
});

test("a floor that is not known is said before anything that its map says", () => {
  for (const fix of [fixAt(1, 2), fixAt(1, 2, "AMBIGUOUS"), nowhere("UNKNOWN_PLACE")]) {
    assert.equal(wordsOf({ ...fix, level: null }).title, "Floor unknown");
    assert.notEqual(wordsOf({ ...fix, level: 0 }).title, "Floor unknown");
  }
  assert.equal(wordsOf({ ...nowhere("NO_ECHO"), level: null }).title, "No echoes heard");
});

test("distances are told no finer than they are known", () => {
  assert.deepEqual([0.04, 0.26, 3.14159, 12.4].map(within), [`0.1${NB}m`, `0.3${NB}m`, `3.1${NB}m`, `12${NB}m`]);
});

test("who does not see the map hears where they are and what they face", () => {
  assert.equal(placeSpoken({ ...fixAt(-1.25, 3), headingRad: Math.PI / 2 }), "At minus 1.3 across and 3.0 up, facing north on the map.");
  assert.equal(placeSpoken({ ...fixAt(0, 0), headingRad: -3.1 }), "At 0.0 across and 0.0 up, facing west on the map.");
  assert.equal(placeSpoken(nowhere("NO_ECHO")), "No place is known.");
});

test("a trail breaks where nothing is known and where the walker is found elsewhere", () => {
  const fixes = [fixAt(0, 0), fixAt(0.7, 0), nowhere("UNKNOWN_PLACE"), fixAt(1.4, 0), fixAt(9, 0), fixAt(9.5, 0)];
  const trail = fixes.reduce(withFix, NO_TRAIL);
  assert.deepEqual(trail.pieces, [[[0, 0], [0.7, 0]], [[1.4, 0]], [[9, 0], [9.5, 0]]]);
  assert.deepEqual([trail.count, trail.total], [5, 6]);
  const lost = withFix(trail, nowhere("NO_ECHO"));
  assert.deepEqual([lost.placed.xyM, lost.fix.status], [[9.5, 0], "NO_ECHO"]);
});

test("a trail forgets its oldest places", () => {
  let trail = NO_TRAIL;
  for (let k = 0; k < 7300; k += 1) trail = withFix(trail, fixAt(k * 0.5, 0));
  assert.equal(trail.pieces.flat().length, 7200);
  assert.deepEqual(trail.pieces[0][0], [50, 0]);
});

test("spots of a map are joined along its walks, and thinned where they crowd", () => {
  const points = [[0, 0], [0.1, 0], [0.2, 0], [5, 0], [5.2, 0]];
  assert.deepEqual(joins(points), [false, true, true, false, true]);
  assert.deepEqual(thinned(points, 0.25), [[0, 0], [5, 0]]);
});

test("maps on the phone come first, and say when the server has a newer one", () => {
  const kept = [
    { map: "b", name: "Office", revision: 2, madeUtc: "2026-01-02T00:00:00Z", sizeBytes: 10 },
    { map: "a", name: "Attic", revision: 1, madeUtc: "2026-01-01T00:00:00Z", sizeBytes: 20 },
  ];
  const offered = [
    { id: "b", name: "Office", created_utc: "2026-01-02T00:00:00Z", revision: 3 },
    { id: "c", name: "Old", created_utc: "2025-01-01T00:00:00Z" },
    { id: "d", name: "New", created_utc: "2026-02-01T00:00:00Z" },
  ];
  const rows = rowsOf(kept, offered);
  assert.deepEqual(rows.map(({ id }) => id), ["a", "b", "d", "c"]);
  assert.deepEqual(rows.map(({ isOld }) => isOld), [false, true, false, false]);
  assert.deepEqual(rows.map(({ canGet }) => canGet), [false, true, true, true]);
  assert.deepEqual(rowsOf(kept, null).map(({ canGet }) => canGet), [false, false]);
});

test("floors near here are offered before others, and what is kept is asked for once", () => {
  const mine = [{ id: "a", name: "Mine", created_utc: "2026-01-01T00:00:00Z" }, { id: "b", name: "Kept", created_utc: "2026-02-01T00:00:00Z" }];
  const near = [{ id: "y", name: "Mall, floor 2", revision: 5 }, { id: "x", name: "Mall, ground floor", revision: 4 }];
  const kept = [{ map: "b", name: "Kept", revision: 1, madeUtc: "", sizeBytes: 1 }, { map: "z", name: "Office, floor 1", revision: 2, madeUtc: "", sizeBytes: 1 }];
  const offers = offersOf(mine, near, kept);
  assert.deepEqual(offers.map(({ id }) => id).sort(), ["a", "b", "x", "y", "z"]);
  assert.equal(offers.find(({ id }) => id === "b").created_utc, "2026-02-01T00:00:00Z");
  assert.deepEqual(rowsOf(kept, offers).map(({ id }) => id), ["b", "z", "y", "x", "a"]);
});

test("maps that links open are offered, and what is shared says by whom", () => {
  const mine = [{ id: "m", name: "Mine", owner: "Ada", right: "own", venue: "Mall", floor: "1" }, { id: "s", name: "Theirs", owner: "Eve", right: "read" }];
  const linked = [{ map: "l", name: "Linked", venue: "Mall", floor: "2", created_utc: "2026-01-01T00:00:00Z", owner: "Ben" }];
  const kept = [{ map: "k", name: "Kept", revision: 1, madeUtc: "", sizeBytes: 1, venue: "Annex", floor: null }];
  const rows = rowsOf(kept, offersOf(mine, [], kept, linked));
  const told = Object.fromEntries(rows.map(({ id, owner, venue, floor }) => [id, [owner, venue, floor]]));
  assert.deepEqual(told, { m: [null, "Mall", "1"], s: ["Eve", null, null], l: ["Ben", "Mall", "2"], k: [null, "Annex", null] });
  assert.deepEqual(rowsOf(kept, null)[0].venue, "Annex", "without a server as well");
});

test("rows stand by venue, each where its first one was", () => {
  const rows = ["b", null, "b", "a", "a"].map((venue, at) => ({ id: String(at), venue }));
  const groups = venuesOf(rows).map(({ venue, rows: inside }) => [venue, inside.map(({ id }) => id).join("")]);
  assert.deepEqual(groups, [["b", "02"], ["a", "34"], [null, "1"]]);
  assert.deepEqual(venuesOf([]), []);
});

test("a phone asks by its position, as surely as it knows it, and by nothing else", () => {
  const coords = { latitude: 47.3, longitude: 8.5, accuracy: 49, altitude: 480, heading: 90, speed: 1 };
  const { position, ...rest } = questionOf({ coords });
  assert.deepEqual(rest, {});
  assert.deepEqual(Object.keys(position), ["latitude_deg", "longitude_deg", "sigma_m"]);
  near(position.sigma_m, 20, 0.05);
  near(questionOf({ coords: { ...coords, accuracy: 0.1 } }).position.sigma_m, 1);
  near(questionOf({ coords: { ...coords, accuracy: 1e6 } }).position.sigma_m, 2000);
});

test("what keeps a phone from asking is said in one line", async () => {
  const failing = (code) => ({ getCurrentPosition: (_, failed) => failed({ code }) });
  await assert.rejects(floorsNear(undefined), { message: NO_POSITION });
  await assert.rejects(floorsNear(failing(1)), { message: REFUSED });
  await assert.rejects(floorsNear(failing(2)), { message: LOST });
  await assert.rejects(floorsNear(failing(3)), { message: LOST });
  const standing = { getCurrentPosition: (found) => found({ coords: { latitude: 1, longitude: 2, accuracy: 20 } }) };
  const answers = (told) => (globalThis.fetch = async () => new Response(JSON.stringify(told)));
  const before = globalThis.fetch;
  try {
    answers({ status: "UNKNOWN_PLACE", candidates: [] });
    await assert.rejects(floorsNear(standing), { message: NOTHING_NEAR });
    answers({ status: "OK", candidates: [{ building: "Mall", floor: 0, map: "m", revision: 3, share: 1 }, { building: "Mall", floor: -1, map: "n", revision: 4, share: 0.1 }] });
    assert.deepEqual(await floorsNear(standing), [
      { id: "m", name: "Mall, ground floor", revision: 3, venue: "Mall", floor: "Ground floor" },
      { id: "n", name: "Mall, floor -1", revision: 4, venue: "Mall", floor: "Floor -1" },
    ]);
  } finally {
    globalThis.fetch = before;
  }
});

test("motion waits for the sound's delay and is moved by it, never backwards", () => {
  const passed = [];
  let latenessS = null;
  const motion = delayMotion({ push: (tS) => passed.push(tS) }, () => latenessS);
  const reading = (tS) => ({ tS, acceleration: [0, 0, 9.8], turning: [0, 0, 0] });
  motion.push([reading(0), reading(0.5)]);
  assert.deepEqual(passed, []);
  latenessS = 0.25;
  motion.push([reading(1), { ...reading(1.1), turning: null }]);
  latenessS = 0.125;
  motion.push([reading(1.0625), reading(1.5)]);
  assert.deepEqual(passed, [0.25, 0.75, 1.25, 1.625]);
});

test("without any chirp motion is not held back for ever", () => {
  const passed = [];
  const motion = delayMotion({ push: (tS) => passed.push(tS) }, () => null);
  motion.push([0, 1, 2].map((tS) => ({ tS, acceleration: [0, 0, 9.8], turning: [0, 0, 0] })));
  assert.deepEqual(passed, []);
  motion.push([{ tS: 3.5, acceleration: [0, 0, 9.8], turning: [0, 0, 0] }]);
  assert.deepEqual(passed, [0, 1, 2, 3.5]);
});

/** Three spots whose features are the first three axes. */
function smallMap() {
  const vectors = new Float32Array(3 * 128);
  [0, 1, 2].forEach((k) => (vectors[k * 128 + k] = 1));
  return {
    xyM: Float32Array.of(0, 0, 5, 0, 10, 0), headingRad: new Float32Array(3), vectors,
    covarianceM2: Float32Array.of(0.01, 0, 0.01, 0.01, 0, 0.01, 0.01, 0, 0.01), phone: null, encoder: "none",
    parameters: { locate: { window_s: 0.5, fewest_echoes: 3, unknown_below: 0.5, temperature: 0.05, near_m: 1, ambiguous_below: 0.6, sigma_floor_m: 0.1 } },
  };
}

/** That map alone, which is of no building. */
const alone = (floorMap) => makeFloors({ level: undefined, floorMap });
const along = (axis) => Float32Array.from({ length: 128 }, (_, d) => (d === axis ? 1 : 0));

/** A cutter that hears an echo every 0.1 s, and a listener that hears spot after spot, a second each. */
function placed(decidingOf, fixes) {
  const map = smallMap();
  const memory = makeMemory(map.parameters.locate.fewest_echoes);
  const cutter = {
    push: (first, samples) => {
      const echoes = [];
      for (let k = first; k < first + samples.length; k += 1) {
        if (k % 10 === 0) echoes.push({ tS: k / 100, samples: new Float32Array(2352).fill(k / 100), facts: {} });
      }
      return echoes;
    },
  };
  const listener = {
    embed: async (samples, n) => {
      const out = new Float32Array(n * 128);
      for (let k = 0; k < n; k += 1) out.set(along(Math.floor(samples[k * 2352] + 1e-4)), k * 128);
      return out;
    },
  };
  const deciding = decidingOf(map, memory);
  return makePlacer({ rateHz: 100, cutter, listener, memory, deciding, onFix: (fix) => fixes.push(fix) });
}

test("a fix for every window of sound, whatever the blocks that it comes in", async () => {
  for (const block of [3, 17, 100]) {
    const fixes = [];
    const placer = placed((floorMap, memory) => decideByWindows({ floors: alone(floorMap), locate: floorMap.parameters.locate, memory }), fixes);
    for (let first = 0; first < 330; first += block) placer.push(first, new Float32Array(Math.min(block, 330 - first)));
    await placer.idle();
    await placer.push(330, new Float32Array(1));
    assert.deepEqual(fixes.map(({ tS }) => tS), [0.25, 0.75, 1.25, 1.75, 2.25, 2.75]);
    fixes.forEach(({ xyM }, k) => near(xyM[0], 5 * Math.floor(k / 2), 1e-3));
  }
});

test("at each footstep the tracker gets what was heard since the one before", async () => {
  const steps = [[0.2, 0.9], [0.9, 1.55], [1.55, 1.7], [1.7, 2.4]].map(([fromS, tS]) => ({ fromS, tS, moveM: [tS - fromS, 0, 0], sigma: [1, 1, 1] }));
  const asked = [];
  const tracker = { step: (move, sigma, scores) => asked.push([move[0], scores && [...scores].map((score) => Number(score > 0.3))]) && { status: "OK", xyM: null } };
  let left = steps;
  const footsteps = {
    take: (nowS) => {
      const ready = left.filter(({ tS }) => tS <= nowS);
      left = left.slice(ready.length);
      return ready;
    },
  };
  const fixes = [];
  const placer = placed((floorMap, memory) => decideBySteps({ floors: alone(floorMap), memory, footsteps, trackerIn: () => tracker }), fixes);
  for (let first = 0; first < 290; first += 10) await placer.push(first, new Float32Array(10));
  assert.deepEqual(fixes.map(({ tS }) => tS), [0.9, 1.55, 1.7, 2.4]);
  assert.deepEqual(asked.map(([, scores]) => scores), [[1, 0, 0], [0, 1, 0], null, [0, 1, 1]]);
  near(asked[0][0], 0.7);
});

test("what is suspect says why, and places nobody by echoes alone", async () => {
  const map = smallMap();
  const memory = makeMemory(3);
  memory.add([0, 0.1, 0.2, 0.3], Float32Array.of(...along(0), ...along(0), ...along(0), ...along(0)));
  const spoofing = { reasonAt: (endS) => (endS < 1 ? 2 : 0) };
  const [fix] = decideByWindows({ floors: alone(map), locate: map.parameters.locate, memory, spoofing }).decide(0.6);
  assert.deepEqual([fix.status, fix.xyM, fix.reason], ["SUSPECT", null, "sound comes before its chirp"]);
  const asked = [];
  const tracker = { step: (move, sigma, scores, suspect) => asked.push(suspect) && { status: "SUSPECT", xyM: [1, 2] } };
  const steps = [{ fromS: 0, tS: 0.7, moveM: [0.7, 0, 0], sigma: [1, 1, 1] }, { fromS: 0.7, tS: 1.4, moveM: [0.7, 0, 0], sigma: [1, 1, 1] }];
  const fixes = decideBySteps({ floors: alone(map), memory, spoofing, trackerIn: () => tracker, footsteps: { take: () => steps } }).decide(2);
  assert.deepEqual(asked, [true, false]);
  assert.deepEqual(fixes.map(({ reason }) => reason), ["sound comes before its chirp", "it sounds like a place that no step leads to"]);
});

test("a listener that fails is told to whoever sent the sound", async () => {
  const map = smallMap();
  const memory = makeMemory(3);
  const placer = makePlacer({
    rateHz: 100, memory, deciding: decideByWindows({ floors: alone(map), locate: map.parameters.locate, memory }), onFix() {},
    cutter: { push: () => [{ tS: 0, samples: new Float32Array(2352) }] },
    listener: { embed: async () => { throw new RangeError("no encoder"); } },
  });
  await assert.rejects(placer.push(0, new Float32Array(10)), /no encoder/);
});

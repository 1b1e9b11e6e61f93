// How the direct arrivals of told chirps are found, on made-up envelopes: jumps, losses, other phones.

import assert from "node:assert/strict";
import { test } from "node:test";

import { makeScheduleSearch } from "../../../../src/elfslam/serve/pages/stages/echo_arrivals.js";
import { MEDIUM_ACCESS } from "../../../../src/elfslam/serve/pages/stages/constants.js";
import { makeHearing } from "../../../../src/elfslam/serve/pages/stages/hearing.js";
import { makeStream } from "../../../../src/elfslam/serve/pages/stages/resample.js";

const RATE_HZ = 44100;
const PERIOD = RATE_HZ / 10;
const PARAMETERS = {
  slack_s: 0.002, early_s: 0.0015, early_share: 0.5, level_share: 0.35, contrast: 8, latest_s: 2.5,
};
const WIDTH = 12;
const BLOCK = 1024;
/** How chirps are spread over their slots. */
const RHYTHMS = { even: 0, random: 0.025 };

function makeRandom(seed) {
  let state = seed;
  return () => {
    state = (state * 16807) % 2147483647;
    return state / 2147483647;
  };
}

const samples = (seconds) => Math.round(seconds * RATE_HZ);

/** Chirps of a schedule and when each is heard, null where it is not. */
function planOf({ count, jitterS, lateS, isLost = () => false, isOurs = () => true, seed = 5 }) {
  const random = makeRandom(seed);
  return Array.from({ length: count }, (_, k) => ({ k, start: samples(0.4 + 0.1 * k + jitterS * random()) }))
    .filter(({ k }) => isOurs(k))
    .map(({ k, start }) => ({ k, start, heard: isLost(k) ? null : start + samples(lateS(k)) }));
}

/** An envelope with peaks at these samples: chirps with a weak echo behind each, others, a little noise. */
function envelopeOf(seconds, peaks) {
  const random = makeRandom(11);
  const envelope = Float32Array.from({ length: samples(seconds) }, () => 1e-4 * random());
  for (const { at, level } of peaks) {
    for (let n = -WIDTH; n <= WIDTH; n += 1) {
      const value = level * (1 - Math.abs(n) / (WIDTH + 1));
      if (at + n >= 0 && at + n < envelope.length) envelope[at + n] = Math.max(envelope[at + n], value);
    }
  }
  return envelope;
}

const heardPeaks = (plan) => plan.filter(({ heard }) => heard !== null)
  .flatMap(({ heard }) => [{ at: heard, level: 0.2 }, { at: heard + 900, level: 0.04 }]);

/** What the search makes of a plan, chirps told a second and a half ahead. */
function searched(plan, others = [], { guess, block = BLOCK, seconds = 0.4 + 0.1 * plan.at(-1).k + 3 } = {}) {
  const envelope = envelopeOf(seconds, [...heardPeaks(plan), ...others]);
  const search = makeScheduleSearch(plan[0].start, PERIOD, PARAMETERS, { guess });
  const stream = makeStream(10 * RATE_HZ);
  const arrivals = [];
  let told = 1;
  for (let at = 0; at < envelope.length; at += block) {
    stream.append(at, envelope.subarray(at, at + block));
    for (; told < plan.length && plan[told].start < at + samples(1.5); told += 1) search.played(plan[told].start);
    for (let more = []; more; more = search.next(stream, false)) arrivals.push(...more);
  }
  return { arrivals, search, envelope };
}

/** Chirps that were found where they were heard; and those said to be somewhere else. */
function judged(plan, arrivals) {
  const byStart = new Map(arrivals.map((each) => [each.played, each]));
  const told = plan.map(({ start, heard }) => ({ heard, found: byStart.get(start) }));
  const isRight = ({ heard, found }) => heard !== null && found?.isFound && Math.abs(found.sample - heard) <= 2;
  return {
    right: told.filter(isRight).length,
    wrong: told.filter((each) => each.found?.isFound && !isRight(each)).length,
    heard: plan.filter(({ heard }) => heard !== null).length,
  };
}

/** Chirps at which nothing was found: in an even rhythm one may be taken for the next one. */
function lostOf(plan, arrivals) {
  const found = new Set(arrivals.filter(({ isFound }) => isFound).map(({ sample }) => sample));
  const isFound = (heard) => [-2, -1, 0, 1, 2].some((off) => found.has(heard + off));
  return plan.filter(({ heard }) => heard !== null && !isFound(heard)).length;
}

for (const [rhythm, jitterS] of Object.entries(RHYTHMS)) {
  for (const lateS of [0.012, 0.135, 0.265, 0.46, 0.9, 1.5, 2.3]) {
    test(`chirps in ${rhythm} rhythm are found though ${1000 * lateS} ms late`, () => {
      const plan = planOf({ count: 40, jitterS, lateS: () => lateS });
      const { arrivals, search } = searched(plan);
      assert.deepEqual(judged(plan, arrivals), { right: 40, wrong: 0, heard: 40 });
      assert.ok(Math.abs(search.lateNow() - samples(lateS)) <= 1);
    });
  }

  for (const byS of [-0.04, 0.005, 0.0213, 0.04, 0.1, 0.2, 0.3]) {
    test(`a jump of ${1000 * byS} ms in ${rhythm} rhythm loses nothing`, () => {
      const lateS = (k) => (k < 30 ? 0.265 : 0.265 + byS);
      const plan = planOf({ count: 60, jitterS, lateS });
      const { arrivals, search } = searched(plan);
      const { right, wrong } = judged(plan, arrivals);
      // By whole periods an even rhythm is the same again.
      if (rhythm === "even" && byS > 0.05) {
        assert.ok(lostOf(plan, arrivals) <= Math.ceil(byS / 0.1));
        return;
      }
      assert.deepEqual([right, wrong], [60, 0]);
      const jumps = arrivals.filter(({ jumped }) => jumped !== 0);
      assert.deepEqual(jumps.map(({ played }) => played), [plan[30].start]);
      assert.ok(Math.abs(jumps[0].jumped - samples(byS)) <= 1);
      assert.ok(Math.abs(search.lateNow() - samples(0.265 + byS)) <= 1);
    });
  }

  test(`several jumps, soon after each other, in ${rhythm} rhythm lose nothing`, () => {
    const lateS = (k) => 0.265 + (k >= 20 ? 0.0075 : 0) + (k >= 24 ? 0.0213 : 0) + (k >= 30 ? (rhythm === "even" ? 0.0426 : 0.0626) : 0);
    const plan = planOf({ count: 50, jitterS, lateS });
    assert.deepEqual(judged(plan, searched(plan).arrivals), { right: 50, wrong: 0, heard: 50 });
  });

  test(`lost sound costs its own chirps alone in ${rhythm} rhythm`, () => {
    for (const lost of [1, 2, 3, 7]) {
      const plan = planOf({ count: 60, jitterS, lateS: () => 0.265, isLost: (k) => k >= 30 && k < 30 + lost });
      const { arrivals } = searched(plan);
      assert.deepEqual(judged(plan, arrivals), { right: 60 - lost, wrong: 0, heard: 60 - lost });
      assert.equal(arrivals.filter(({ isFound }) => !isFound).length, lost);
      assert.ok(arrivals.every(({ jumped }) => jumped === 0));
    }
  });

  test(`sound that is lost and comes back later than before is found, in ${rhythm} rhythm`, () => {
    const lateS = (k) => (k < 30 ? 0.265 : 0.295);
    const plan = planOf({ count: 80, jitterS, lateS, isLost: (k) => k >= 27 && k < 42 });
    const { arrivals } = searched(plan);
    assert.ok(lostOf(plan, arrivals) <= 2);
    if (rhythm === "random") assert.equal(judged(plan, arrivals).wrong, 0);
  });

  test(`cut in any blocks, arrivals in ${rhythm} rhythm are the same`, () => {
    const plan = planOf({ count: 50, jitterS, lateS: (k) => (k < 25 ? 0.265 : 0.305), isLost: (k) => k === 12 });
    const [small, large] = [128, 4801].map((block) => searched(plan, [], { block }).arrivals);
    assert.deepEqual(small, large);
  });
}

for (const seed of [1, 2, 3, 4, 5, 6, 7, 8]) {
  test(`own chirps by turns are told from another phone's, through a jump (${seed})`, () => {
    const random = makeRandom(100 + seed);
    const mine = Array.from({ length: 8 }, () => random() < 0.5);
    mine[seed % 8] = true;
    mine[(seed + 3) % 8] = false;
    const lateS = (k) => (k < 70 ? 0.265 : 0.4);
    const plan = planOf({ count: 140, jitterS: 0.025, lateS, isOurs: (k) => mine[k % 8], seed });
    const theirs = planOf({ count: 140, jitterS: 0.025, lateS: () => 0, isOurs: (k) => !mine[k % 8], seed: seed + 50 });
    const others = theirs.map(({ heard }) => ({ at: heard + samples(0.3), level: 0.1 }));
    const { right, wrong, heard } = judged(plan, searched(plan, others).arrivals);
    assert.ok(right >= heard - 3 && wrong <= 3, `${right} of ${heard}, ${wrong} wrong`);
  });
}

test("while nothing is heard nothing is found, and what comes then is", () => {
  const plan = planOf({ count: 90, jitterS: 0.025, lateS: () => 0.265, isLost: (k) => k < 40 });
  const { right, wrong, heard } = judged(plan, searched(plan).arrivals);
  assert.ok(right >= heard - 3 && wrong === 0, `${right} of ${heard}, ${wrong} wrong`);
});

test("how late a moment is heard is said once its chirp is settled, and by the jump that came before", () => {
  const plan = planOf({ count: 60, jitterS: 0.025, lateS: (k) => (k < 30 ? 0.265 : 0.305) });
  const { search } = searched(plan, [], { guess: 77 });
  assert.equal(search.late(plan[0].start - 1), search.late(plan[0].start));
  for (const { start, heard } of plan) assert.ok(Math.abs(search.late(start) - (heard - start)) <= 1);
  search.played(plan[59].start + PERIOD);
  assert.equal(search.late(plan[59].start + PERIOD), undefined);
  const fresh = makeScheduleSearch(5000, PERIOD, PARAMETERS, { guess: 77 });
  assert.equal(fresh.late(4000), 77);
});

/** What is heard in all slots of a plan, and how often, where the microphone's stream begins so late. */
function heardSlots(plan, envelope, count, beginS = 0) {
  const begin = samples(beginS);
  const starts = plan.map(({ start }) => start - begin);
  const stream = makeStream(10 * RATE_HZ);
  const search = makeScheduleSearch(starts[0], PERIOD, PARAMETERS, { guess: samples(0.07) });
  starts.slice(1).forEach((start) => search.played(start));
  const hearing = makeHearing(RATE_HZ, PERIOD, MEDIUM_ACCESS);
  for (let k = 0; k < count; k += 1) {
    const played = plan.findIndex((each) => each.k === k);
    hearing.add({ slot: k, start: samples(0.4 + 0.1 * k) - begin, played: starts[played] ?? null });
  }
  const late = (sample) => (sample < 0 ? samples(0.2) : search.late(sample)); // as far as is known before
  const heard = [];
  for (let at = begin; at < envelope.length; at += BLOCK) {
    stream.append(at - begin, envelope.subarray(at, at + BLOCK));
    for (let more = []; more; more = search.next(stream, false));
    heard.push(...hearing.take({ envelope: stream.slice, end: stream.end, late }));
  }
  return heard;
}

test("own chirps are not heard as another's, whatever jumps", () => {
  for (const byS of [0.0213, 0.04, 0.2]) {
    const lateS = (k) => (k < 30 ? 0.265 : 0.265 + byS);
    const plan = planOf({ count: 70, jitterS: 0.025, lateS, isOurs: (k) => k >= 10 });
    plan[0] = { k: 10, start: samples(1.4), heard: samples(1.4) + samples(0.265) }; // close behind silence
    const skirts = plan.map(({ heard }) => ({ at: heard - samples(0.008), level: 1e-3 }));
    const envelope = envelopeOf(9, [...heardPeaks(plan), ...skirts]);
    const heard = heardSlots(plan, envelope, 70);
    assert.ok(heard.length >= 66, `${heard.length} slots`);
    assert.deepEqual(heard.filter(({ othersS }) => othersS.length > 0), []);
  }
});

test("a chirp that a stall of the sound tears in two is not half another's", () => {
  for (const byS of [0.0003, 0.0213, 0.04]) {
    for (const torn of [20, 21]) {
      const lateS = (k) => (k < 30 ? 0.265 : 0.265 + byS);
      const plan = planOf({ count: 70, jitterS: 0.025, lateS, isOurs: (k) => k >= 10 });
      const { start } = plan[torn];
      const halves = [0.265, 0.265 + byS].map((late) => ({ at: start + samples(late), level: 0.1 }));
      const skirt = { at: start + samples(0.265 - 0.005), level: 2e-3 };
      const rest = heardPeaks(plan.filter((_, k) => k !== torn));
      const heard = heardSlots(plan, envelopeOf(9, [...rest, ...halves, skirt]), 70);
      assert.ok(heard.length >= 62, `${heard.length} slots`);
      assert.deepEqual(heard.filter(({ othersS }) => othersS.length > 0), []);
    }
  }
});

test("of slots before the stream began nothing is said, and of those behind it the truth", () => {
  for (const beginS of [0.9, 1.37]) {
    const plan = planOf({ count: 70, jitterS: 0.025, lateS: () => 0.2, isOurs: (k) => k % 3 > 0 });
    const others = [30, 45].map((k) => ({ at: samples(0.4 + 0.1 * k + 0.212), level: 0.1 }));
    const envelope = envelopeOf(8, [...heardPeaks(plan), ...others]);
    const heard = heardSlots(plan, envelope, 70, beginS);
    const first = Math.ceil((beginS - 0.4 - 0.2) / 0.1);
    assert.ok(heard.every(({ slot }) => slot >= first), `slot ${heard[0].slot} of ${first}`);
    assert.ok(heard.length >= 67 - first, `${heard.length} slots`);
    assert.deepEqual(heard.filter(({ othersS }) => othersS.length > 0).map(({ slot }) => slot), [30, 45]);
  }
});

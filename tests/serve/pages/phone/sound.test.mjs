// The sound of the phone page against what elfslam computes in Python: vectors come from
// test_phone_modules.py, which names their file in ELFSLAM_VECTORS.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import { makeFramer, PATIENCE } from "../../../../src/elfslam/serve/pages/phone/framer.js";
import { makeBandFilter, makeBaseband, scaleOf, toInt16 } from "../../../../src/elfslam/serve/pages/phone/baseband.js";
import { CHIRP, excitationOf, periodSamples } from "../../../../src/elfslam/serve/pages/stages/chirp.js";
import {
  analyticSignal, complexZeros, earliest, fourierOf, makeMatchedFilter, median,
} from "../../../../src/elfslam/serve/pages/stages/matched_filter.js";
import { makeHearing } from "../../../../src/elfslam/serve/pages/stages/hearing.js";
import { MEDIUM_ACCESS } from "../../../../src/elfslam/serve/pages/stages/constants.js";
import { bestOf } from "../../../../src/elfslam/serve/pages/phone/microphone.js";
import { measure } from "../../../../src/elfslam/serve/pages/phone/probe.js";
import { makeStream } from "../../../../src/elfslam/serve/pages/stages/resample.js";

const vectors = JSON.parse(readFileSync(process.env.ELFSLAM_VECTORS, "utf8"));
const RATES_HZ = [44100, 48000];

function assertNear(got, wanted, tolerance, what) {
  assert.equal(got.length, wanted.length, `${what}: length`);
  for (let k = 0; k < got.length; k += 1) {
    assert.ok(Math.abs(got[k] - wanted[k]) <= tolerance, `${what}[${k}]: ${got[k]}, wanted ${wanted[k]}`);
  }
}

for (const rateHz of RATES_HZ) {
  const given = vectors[rateHz];
  const sound = Float32Array.from(given.sound);

  test(`the chirp at ${rateHz} Hz is elfslam's`, () => {
    assertNear(excitationOf(vectors.chirp, rateHz), given.chirp, 1e-6, "chirp");
    assertNear(excitationOf(CHIRP, rateHz), given.chirp, 1e-6, "chirp by default");
  });

  test(`the matched filter at ${rateHz} Hz is elfslam's`, () => {
    const block = sound.subarray(0, 6000);
    const envelope = makeMatchedFilter(excitationOf(CHIRP, rateHz), block.length)(block);
    assertNear(envelope, given.envelope.slice(0, envelope.length), 2e-6, "envelope");
  });

  test(`the band at ${rateHz} Hz is what the definition says`, () => {
    const baseband = makeBaseband(rateHz);
    const k = given.baseband.first;
    const [from, to] = baseband.needs(k);
    const stream = makeStream(sound.length);
    stream.append(0, sound);
    const frame = baseband.frame(stream.slice(from, to), from, k);
    assertNear(frame, given.baseband.iq, 1e-6, "baseband");
  });

  test(`frames at ${rateHz} Hz begin where elfslam finds the direct sound`, () => {
    const framer = makeFramer(framing(rateHz, "baseband"));
    const frames = pushed(framer, sound, 1000);
    const direct = frames.filter(({ arrival }) => arrival.isFound).map(({ arrival }) => arrival.sample / rateHz);
    assertNear(direct, given.arrivals_s.slice(0, direct.length), 1.5 / 44100, "arrivals");
    assert.ok(direct.length >= given.arrivals_s.length - 2);
    assert.ok(frames.every(({ tS, arrival }) => Math.abs(arrival.sample / rateHz - tS - 0.005) < 1 / 6300));
  });

  test(`cut in any blocks, frames at ${rateHz} Hz are the same`, () => {
    for (const kind of ["baseband", "whole"]) {
      const whole = pushed(makeFramer(framing(rateHz, kind)), sound, sound.length);
      const small = pushed(makeFramer(framing(rateHz, kind)), sound, 700);
      assert.ok(whole.length > 5);
      assert.deepEqual(small, whole);
    }
  });

  test(`the band as sound at ${rateHz} Hz is elfslam's`, () => {
    const { reach, apply } = makeBandFilter(rateHz);
    const got = apply(sound.subarray(0, 6000));
    assertNear(got, given.in_band.slice(reach, 6000 - reach), 1e-6, "in band");
  });

  test(`whole frames at ${rateHz} Hz are the band of the sound, at its place`, () => {
    const [frame] = pushed(makeFramer(framing(rateHz, "whole")), sound, 5000);
    const first = Math.round(frame.tS * rateHz);
    const view = new DataView(frame.bytes.buffer);
    assert.equal(frame.bytes.length, 2 * Math.round(0.08 * rateHz));
    const until = Math.min(frame.bytes.length / 2, given.in_band.length - first);
    assert.ok(until > 1000);
    for (let k = 0; k < until; k += 1) {
      assert.ok(Math.abs(view.getInt16(2 * k, true) - given.in_band[first + k] * 32767) < 0.6);
    }
  });

  test(`what is said near the phone at ${rateHz} Hz changes no bit of what is kept`, () => {
    const spoken = sound.map((value, n) => value + speech(n / rateHz));
    for (const kind of ["baseband", "whole"]) {
      const quiet = pushed(makeFramer(framing(rateHz, kind)), sound, 5000);
      const loud = pushed(makeFramer(framing(rateHz, kind)), spoken, 5000);
      assert.deepEqual(loud.map((frame) => frame.tS), quiet.map((frame) => frame.tS));
      let others = 0;
      loud.forEach((frame, f) => frame.bytes.forEach((byte, k) => { others += byte !== quiet[f].bytes[k] ? 1 : 0; }));
      // Where a value lies at the middle between two steps, the float32 of the sum falls either way.
      assert.ok(others < 2e-2 * loud.length * loud[0].bytes.length, `${kind}: ${others} bytes differ`);
    }
  });
}

/** As loud as full scale allows, all over the band of speech, and as float32 as a microphone gives it. */
function speech(tS) {
  let sum = 0;
  for (let hz = 150; hz < 8000; hz += 317) sum += Math.cos(2 * Math.PI * hz * tS + hz);
  return sum / 30;
}

function framing(rateHz, kind) {
  const chirp = excitationOf(CHIRP, rateHz);
  return { rateHz, chirp, period: periodSamples(CHIRP, rateHz), kind };
}

function pushed(framer, sound, size) {
  const frames = [];
  for (let first = 0; first < sound.length; first += size) {
    frames.push(...framer.push(first, sound.subarray(first, first + size)).frames);
  }
  return frames;
}

/** Chirps of amplitude 0.2 at the given samples, over a little noise. */
function played(rateHz, count, starts, noise = 1e-4) {
  let seed = 1;
  const random = () => {
    seed = (seed * 16807) % 2147483647;
    return seed / 2147483647 - 0.5;
  };
  const sound = Float32Array.from({ length: count }, () => noise * random());
  const chirp = excitationOf(CHIRP, rateHz);
  for (const start of starts) chirp.forEach((value, k) => { sound[start + k] += 0.2 * value; });
  return sound;
}

for (const echoDb of [10, 30]) {
  test(`echoes ${echoDb} dB over the noise are measured as that; where there are no chirps, as nothing`, () => {
    const rateHz = 48000;
    const starts = Array.from({ length: 10 }, (_, c) => 9000 + 4800 * c);
    const sound = played(rateHz, 60000, starts, 0);
    const chirp = excitationOf(CHIRP, rateHz);
    const envelopeOf = (samples) => makeMatchedFilter(chirp, samples.length)(samples);
    const meanPower = (values) => values.reduce((sum, value) => sum + value * value, 0) / values.length;
    const noise = played(rateHz, 60000, [], 0.02);
    const level = Math.sqrt(meanPower(envelopeOf(noise)) * 10 ** (echoDb / 10));
    const echo = new Float32Array(60000);
    for (const start of starts) chirp.forEach((value, k) => { echo[start + 1100 + k] += value; });
    const stretch = envelopeOf(echo).subarray(9000 + 528, 9000 + 1680);
    const gain = level / Math.sqrt(meanPower(stretch));
    const heard = sound.map((value, n) => 10 * gain * value + gain * echo[n] + noise[n]);
    const due = { first: 8900, period: 4800, count: 10 };
    const off = measure(heard, rateHz, chirp, due, [15000, 20000]).echoDb - 10 * Math.log10(1 + 10 ** (echoDb / 10));
    assert.ok(Math.abs(off) < 1, `${off} dB off`);
    const clicked = heard.slice();
    clicked[8900 + 3 * 4800 + Math.round(0.083 * rateHz)] += 0.5;
    const moved = measure(clicked, rateHz, chirp, due, [15000, 20000]).echoDb - measure(heard, rateHz, chirp, due, [15000, 20000]).echoDb;
    assert.ok(Math.abs(moved) < 0.5, `one click moves the level by ${moved} dB`);
    assert.equal(measure(noise, rateHz, chirp, due, [15000, 20000]).echoDb, null);
    assert.equal(measure(new Float32Array(60000), rateHz, chirp, due, [15000, 20000]).echoDb, null);
  });
}

test("of several microphones the loudest is chosen, the given one where none is well ahead", () => {
  const tried = (...levels) => levels.map((echoDb, k) => ({ deviceId: `${k}`, label: "", echoDb }));
  assert.equal(bestOf(tried(10, 30, 12), "0").deviceId, "1");
  assert.equal(bestOf(tried(10, 12, null), "0").deviceId, "0");
  assert.equal(bestOf(tried(null, -5), "0").deviceId, "1");
  assert.equal(bestOf(tried(null, null), "1").deviceId, "1");
  assert.equal(bestOf(tried(20, 24), "gone").deviceId, "1");
});

test("a jump of the stream is found and told", () => {
  const starts = Array.from({ length: 20 }, (_, c) => 3000 + 4800 * c + (c >= 9 ? 1024 : 0));
  const frames = pushed(makeFramer(framing(48000, "baseband")), played(48000, 100000, starts), 2000);
  const jumps = frames.filter((frame) => frame.arrival.jumped !== 0).map((frame) => frame.arrival.jumped);
  assert.deepEqual(jumps, [1024]);
  assert.deepEqual(frames.map((frame) => frame.arrival.sample), starts.slice(0, frames.length));
});

test("where no chirp is heard the frame is kept and counted as missed", () => {
  const starts = Array.from({ length: 20 }, (_, c) => 3000 + 4800 * c).filter((_, c) => c < 8 || c > 10);
  const frames = pushed(makeFramer(framing(48000, "baseband")), played(48000, 100000, starts), 2000);
  const missed = frames.map((frame, c) => (frame.arrival.isFound ? -1 : c)).filter((c) => c >= 0);
  assert.deepEqual(missed, [8, 9, 10]);
});

test("chirps that become much softer are found again after a while", () => {
  const rateHz = 48000;
  const loud = Array.from({ length: 20 }, (_, c) => 3000 + 4800 * c);
  const soft = Array.from({ length: 30 }, (_, c) => 3000 + 4800 * (20 + c));
  const sound = played(rateHz, 243000, loud);
  const quiet = played(rateHz, 243000, soft, 0);
  quiet.forEach((value, k) => { sound[k] += 0.1 * value; });
  const frames = pushed(makeFramer(framing(rateHz, "baseband")), sound, 4096);
  const missed = frames.filter((frame) => !frame.arrival.isFound).length;
  assert.equal(missed, PATIENCE);
});

test("sound without chirps gives no frames", () => {
  assert.deepEqual(pushed(makeFramer(framing(48000, "baseband")), played(48000, 96000, []), 1000), []);
});

test("lost samples are filled with silence, so that the clock goes on", () => {
  const stream = makeStream(100);
  assert.equal(stream.append(0, Float32Array.of(1, 2, 3)), 0);
  assert.equal(stream.append(5, Float32Array.of(6, 7)), 2);
  assert.deepEqual([...stream.slice(-1, 8)], [0, 1, 2, 3, 0, 0, 6, 7, 0]);
  assert.equal(stream.append(6, Float32Array.of(99, 8)), 0);
  assert.deepEqual([...stream.slice(4, 8)], [0, 6, 7, 8]);
});

/** Chirps and an echo each, played at these samples and heard `late` samples later. */
function playedSound(played, late, rateHz, seconds, level = 0.2) {
  const chirp = excitationOf(CHIRP, rateHz);
  const sound = Float32Array.from({ length: seconds * rateHz }, (_, n) => 1e-4 * Math.sin(n * n));
  for (const start of played) {
    for (const [gain, delay] of [[1, 0], [0.3, 1000]]) {
      chirp.forEach((value, n) => { sound[start + late + delay + n] += level * gain * value; });
    }
  }
  return sound;
}

const RANDOM = [0.3, 0.9, 0.1, 0.7, 0.5, 0.2, 0.95, 0.05, 0.6, 0.4];

function randomSchedule(count, rateHz, from = 0.3) {
  return Array.from({ length: count }, (_, k) =>
    Math.round((from + 0.1 * k + 0.025 * RANDOM[(k * 7 + (k >> 3)) % 10]) * rateHz));
}

for (const rateHz of RATES_HZ) {
  for (const hint of [null, 0, 2000]) {
    test(`chirps of a random schedule at ${rateHz} Hz are found, known to be ${hint} late`, () => {
      const late = hint || Math.round(0.31 * rateHz);
      const played = randomSchedule(60, rateHz);
      const framer = makeFramer({ ...framing(rateHz, "whole"), late: hint });
      played.forEach((sample) => framer.played(sample));
      const frames = pushed(framer, playedSound(played, late, rateHz, 8), 1024);
      const found = frames.filter(({ arrival }) => arrival.isFound).map(({ arrival }) => arrival);
      const right = found.filter(({ sample, played: from }) => Math.abs(sample - from - late) <= 1);
      assert.ok(right.length >= 59, `${right.length} of ${found.length} are right`);
      assert.equal(right.length, found.length);
      assert.ok(Math.abs(framer.heard.late(played[0]) - late) <= 1);
    });
  }
}

for (const kind of ["baseband", "whole"]) {
  test(`a walk that goes on (${kind}) has the frames of one that never stopped, so much later`, () => {
    const rateHz = 48000;
    const played = randomSchedule(40, rateHz);
    const sound = playedSound(played, 9000, rateHz, 6);
    const origin = 600 * rateHz; // ten minutes in, and no memory grows with it
    const at = (from) => {
      const framer = makeFramer({ ...framing(rateHz, kind), late: 9000, origin: from });
      played.forEach((sample) => framer.played(from + sample));
      const frames = [];
      for (let first = 0; first < sound.length; first += 1024) {
        const { frames: cut, missing } = framer.push(from + first, sound.subarray(first, first + 1024));
        assert.equal(missing, 0);
        frames.push(...cut);
      }
      assert.equal(framer.end(), from + sound.length);
      return frames;
    };
    const [fresh, later] = [at(0), at(origin)];
    assert.ok(fresh.length >= 38);
    assert.deepEqual(later.map(({ arrival }) => arrival.sample - origin), fresh.map(({ arrival }) => arrival.sample));
    assertNear(later.map(({ tS }) => tS - 600), fresh.map(({ tS }) => tS), 2e-4, "times");
    assert.deepEqual(later.map(({ bytes }) => bytes.length), fresh.map(({ bytes }) => bytes.length));
  });
}

test("another phone's chirps are not taken for those of a schedule", () => {
  const rateHz = 44100;
  const played = randomSchedule(60, rateHz);
  const sound = playedSound(played, 9000, rateHz, 8);
  const theirs = playedSound(played.map((_, k) => played[59 - k] % 4410 + 4410 * (k + 4)), 0, rateHz, 8, 0.1);
  theirs.forEach((value, n) => { sound[n] += value; });
  const framer = makeFramer({ ...framing(rateHz, "whole"), late: null });
  played.forEach((sample) => framer.played(sample));
  const found = pushed(framer, sound, 1024).filter(({ arrival }) => arrival.isFound);
  const off = found.map(({ arrival }) => Math.abs(arrival.sample - arrival.played - 9000));
  assert.ok(off.filter((samples) => samples <= 2).length >= 50, off.join(" "));
});

test("others are heard in silent slots and in silence before the own chirp", () => {
  for (const rateHz of RATES_HZ) {
    const period = rateHz / 10;
    const late = Math.round(0.2 * rateHz);
    const slots = Array.from({ length: 60 }, (_, slot) => {
      const start = Math.round(0.3 * rateHz) + slot * period;
      const isOurs = slot % 2 === 0;
      return { slot, start, played: isOurs ? start + Math.round(0.025 * RANDOM[slot % 10] * rateHz) : null };
    });
    const played = slots.filter((each) => each.played !== null).map((each) => each.played);
    const others = [11, 23, 35, 47].map((slot) => slots[slot].start + Math.round(0.012 * rateHz));
    const sound = playedSound(played, late, rateHz, 7);
    playedSound(others, late, rateHz, 7, 0.02).forEach((value, n) => { sound[n] += value; });
    const framer = makeFramer({ ...framing(rateHz, "whole"), late });
    const hearing = makeHearing(rateHz, period, MEDIUM_ACCESS);
    for (const slot of slots) {
      hearing.add(slot);
      if (slot.played !== null) framer.played(slot.played);
    }
    const heard = [];
    for (let first = 0; first < sound.length; first += 1024) {
      framer.push(first, sound.subarray(first, first + 1024));
      heard.push(...hearing.take(framer.heard));
    }
    const met = heard.filter(({ othersS }) => othersS.length > 0);
    assert.deepEqual(met.map(({ slot }) => slot), [11, 23, 35, 47]);
    assert.ok(met.every(({ othersS }) => Math.abs(othersS[0] + 0.0005) < 0.001));
    assert.ok(heard.length >= 57);
  }
});

test("the stream forgets what is behind it and nothing else", () => {
  const stream = makeStream(64);
  for (let first = 0; first < 10000; first += 50) {
    stream.append(first, Float32Array.from({ length: 50 }, (_, k) => first + k));
    stream.forget(first - 100);
  }
  const tail = Array.from({ length: 150 }, (_, k) => 9850 + k);
  assert.deepEqual([...stream.slice(9850, 10000)], tail);
});

test("a louder echo is not taken for the direct sound", () => {
  const envelope = Float32Array.of(0, 0.1, 0.7, 0.2, 0.1, 1.0, 0.1);
  assert.equal(earliest(envelope, 5, 4, 0.5), 2);
  assert.equal(earliest(envelope, 5, 4, 0.8), 5);
});

test("transform and back is the same, and a tone lies in its bin", () => {
  const { forward, inverse } = fourierOf(64);
  const x = complexZeros(64);
  for (let n = 0; n < 64; n += 1) x.re[n] = Math.cos((2 * Math.PI * 5 * n) / 64);
  const before = Float64Array.from(x.re);
  forward(x);
  assert.ok(Math.abs(x.re[5] - 32) < 1e-9 && Math.abs(x.re[59] - 32) < 1e-9);
  inverse(x);
  assertNear(x.re, before, 1e-12, "there and back");
  assert.throws(() => fourierOf(60), /power of two/);
});

test("the analytic signal of a cosine turns once per period", () => {
  const x = analyticSignal(Array.from({ length: 441 }, (_, n) => Math.cos((2 * Math.PI * 7 * n) / 441)));
  const wanted = Array.from({ length: 441 }, (_, n) => Math.sin((2 * Math.PI * 7 * n) / 441));
  assertNear(x.im, wanted, 1e-9, "imaginary part");
});

test("other rates and other excitations are refused with what to do", () => {
  assert.throws(() => excitationOf(CHIRP, 16000), /16000.*headset/);
  assert.throws(() => excitationOf({ ...CHIRP, kind: "tone" }, 48000), /tone/);
});

test("sixteen bits are held, and the scale is the least that clips nothing", () => {
  assert.deepEqual([...toInt16(Float64Array.of(0, 0.5, 2, -2), 1 / 32767)], [0, 16384, 32767, -32767]);
  assert.deepEqual([...toInt16(Float64Array.of(0.01, -0.02), scaleOf(Float64Array.of(0.01, -0.02)))], [16384, -32767]);
  assert.ok(scaleOf(new Float64Array(4)) > 0);
});

test("the probe measures level, timing and signal over noise", () => {
  const rateHz = 48000;
  const chirp = excitationOf(CHIRP, rateHz);
  const first = 0.6 * rateHz;
  const starts = Array.from({ length: 20 }, (_, c) => first + 4800 * c + 1500);
  const sound = played(rateHz, 140000, starts, 2e-3);
  const got = measure(sound, rateHz, chirp, { first, period: 4800, count: 20 }, CHIRP.band_hz);
  assert.ok(Math.abs(got.peak - 0.2) < 0.005);
  assert.equal(got.heard, 20);
  assert.ok(got.jitterS <= 1 / rateHz);
  assert.ok(Math.abs(got.latencyS - 1500 / rateHz) < 2 / rateHz);
  assert.deepEqual(got.subbands.map((band) => band.lowHz), [15000, 16000, 17000, 18000, 19000]);
  assert.ok(got.subbands.every((band) => band.snrDb > 25));
  const silence = measure(played(rateHz, 140000, [], 2e-3), rateHz, chirp, { first, period: 4800, count: 20 }, CHIRP.band_hz);
  assert.equal(silence.heard, 0);
  assert.ok(silence.subbands.every((band) => Math.abs(band.snrDb) < 3));
});

test("a band that is cut off is noticed", () => {
  const rateHz = 48000;
  const chirp = excitationOf({ ...CHIRP, band_hz: [15000, 17500] }, rateHz);
  const first = 0.6 * rateHz;
  const sound = played(rateHz, 140000, [], 2e-3);
  for (let c = 0; c < 20; c += 1) chirp.forEach((value, k) => { sound[first + 4800 * c + 1500 + k] += 0.2 * value; });
  const { subbands } = measure(sound, rateHz, excitationOf(CHIRP, rateHz), { first, period: 4800, count: 20 }, CHIRP.band_hz);
  assert.ok(subbands[1].snrDb > 25 && subbands[4].snrDb < 12);
});

test("the median of nothing is nothing", () => {
  assert.ok(Number.isNaN(median([])));
  assert.equal(median([3, 1, 2]), 2);
  assert.equal(median([4, 1, 2, 3]), 2.5);
});

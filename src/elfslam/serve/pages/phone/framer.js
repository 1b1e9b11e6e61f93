/** From the stream to frames: finds the direct arrival of every chirp and cuts what is kept of it. */

import { NOTHING_YET, nextArrival, wantedStretch } from "./arrivals.js";
import { BASEBAND, makeBaseband, toInt16 } from "./baseband.js";
import { makeMatchedFilter } from "./matched_filter.js";
import { frameRow, toBytes, toPcm } from "./sound_files.js";
import { PATIENCE, STRETCH, findLate, lateBy, scheduledArrival } from "./scheduled.js";
import { makeStream } from "./stream.js";

const FRAME_S = 0.08;
/** Chirps in vain, before any was heard, and how late they come is not believed. */
const DOUBTFUL = 3;

/**
 * @typedef {"baseband" | "whole"} Kind what is kept: the chirp band alone, or the whole sound
 * @typedef {{arrival: import("./arrivals.js").Arrival, tS: number, row: string, bytes: Uint8Array}} Frame
 * @typedef {{push: (first: number, samples: Float32Array) => {frames: Frame[], missing: number},
 *   played: (sample: number) => void, late: () => number | null,
 *   envelope: (from: number, to: number) => Float32Array, end: () => number}} Framer
 *   played: tells when a chirp was played, before it can be heard; without it they come once per period.
 *   late: samples from playing to hearing
 */

/**
 * @param {{rateHz: number, chirp: Float32Array, period: number, kind: Kind, scale: number, late?: number | null}} given period
 *   in samples; scale: what one step of the 16 bits stands for in the baseband; late: samples from playing
 *   to hearing, as far as that is known
 * @returns {Framer}
 */
export function makeFramer({ rateHz, chirp, period, kind, scale, late = null }) {
  const stream = makeStream(4 * rateHz);
  const envelopeOf = makeMatchedFilter(chirp, period + chirp.length);
  const cutter = kind === "baseband" ? basebandCutter(rateHz, scale) : wholeCutter(rateHz);
  let search = NOTHING_YET;
  let hunted = 0;
  let lateness = lateBy(late);
  let isScheduled = false;
  const schedule = [];
  const inVain = [];
  let waiting = [];
  let last = -1;

  const findMore = () => {
    for (;;) {
      const [from, to] = wantedStretch(search, period, hunted);
      if (stream.end() < to + chirp.length) return;
      const envelope = envelopeOf(stream.slice(from, to + chirp.length - 1));
      const step = nextArrival(search, envelope, from, period, rateHz);
      search = step.search;
      hunted = to;
      if (step.arrival) waiting.push(step.arrival);
    }
  };

  /** Envelope of [from, to), block by block. */
  const envelope = (from, to) => {
    const out = new Float32Array(Math.max(to - from, 0));
    for (let at = from; at < to; at += period) {
      const end = Math.min(at + period, to);
      out.set(envelopeOf(stream.slice(at, end + chirp.length - 1)), at - from);
    }
    return out;
  };

  const isLateKnown = () => {
    if (lateness.late !== null && lateness.missed < PATIENCE) return true;
    const [first] = schedule;
    const last = first + Math.round(STRETCH.seconds * rateHz);
    const end = last + Math.round(STRETCH.latestS * rateHz);
    if (stream.end() < end + chirp.length) return false;
    const stretch = schedule.filter((sample) => sample < last);
    const found = findLate(envelope(first, end), first, stretch, rateHz);
    if (found !== null) lateness = lateBy(found);
    else if (lateness.late === null) schedule.shift();
    else lateness = { ...lateness, missed: 0 };
    return lateness.late !== null;
  };

  const findScheduled = () => {
    while (schedule.length > 0 && isLateKnown()) {
      const due = schedule[0] + lateness.late;
      const from = Math.max(due - (period >> 1), 0);
      const to = due + (period >> 1);
      if (stream.end() < to + chirp.length) return;
      const step = scheduledArrival(lateness, envelope(from, to), from, schedule.shift(), rateHz);
      lateness = step.lateness;
      hunted = to;
      if (lateness.recent.length === 0) doubt(step.arrival.played);
      else if (step.arrival.sample >= 0) waiting.push(step.arrival);
    }
  };

  /** What was said of the lateness may be wrong: after some chirps in vain all are searched anew. */
  const doubt = (sample) => {
    inVain.push(sample);
    if (inVain.length < DOUBTFUL) return;
    schedule.unshift(...inVain.splice(0));
    lateness = lateBy(null);
  };

  const played = (sample) => {
    isScheduled = true;
    schedule.push(sample);
  };

  const cutReady = () => {
    const frames = [];
    while (waiting.length > 0 && cutter.lastNeeded(waiting[0].sample) <= stream.end()) {
      const arrival = waiting.shift();
      const index = cutter.index(arrival.sample);
      if (index <= last) continue;
      last = index;
      frames.push({ arrival, ...cutter.cut(stream, index) });
    }
    return frames;
  };

  const push = (first, samples) => {
    const missing = stream.append(first, samples);
    if (isScheduled) findScheduled();
    else if (late === null) findMore();
    const frames = cutReady();
    const due = isScheduled ? (inVain[0] ?? schedule[0] ?? stream.end()) : (search.due ?? hunted);
    const oldest = Math.min(waiting[0]?.sample ?? due, due);
    stream.forget(oldest - Math.max(2 * period, rateHz));
    return { frames, missing };
  };

  return { push, played, late: () => lateness.late, envelope, end: stream.end };
}

function basebandCutter(rateHz, scale) {
  const baseband = makeBaseband(rateHz);
  return {
    index: baseband.firstIndex,
    lastNeeded: (direct) => baseband.needs(baseband.firstIndex(direct))[1],
    cut: (stream, k) => {
      const [from, to] = baseband.needs(k);
      const values = baseband.frame(stream.slice(from, to), from, k);
      const tS = k / BASEBAND.rateHz;
      return { tS, row: frameRow(tS), bytes: toBytes(toInt16(values, scale)) };
    },
  };
}

function wholeCutter(rateHz) {
  const lead = Math.round(BASEBAND.leadS * rateHz);
  const length = Math.round(FRAME_S * rateHz);
  const index = (direct) => Math.max(direct - lead, 0);
  return {
    index,
    lastNeeded: (direct) => index(direct) + length,
    cut: (stream, first) => {
      const tS = first / rateHz;
      return { tS, row: frameRow(tS), bytes: toPcm(stream.slice(first, first + length)) };
    },
  };
}

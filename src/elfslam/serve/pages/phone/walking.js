/** A walk being recorded: chirps go out, frames and motion come in, and all of it goes to the storage. */

import { Problem } from "../shared/api.js";
import { t } from "../shared/words.js";
import { median } from "../stages/matched_filter.js";
import { soundTime } from "./clocks.js";
import { CHECKPOINTS, CHIRPS, manifestOf } from "./manifest.js";
import { NO_STEPS, TABLE_HEADER, countStep, listenToMotion, tableRow } from "./motion.js";

const FLUSH_EVERY_MS = 1000;
const SAVE_EVERY = 5;
const FIRST_CHIRP_S = 0.25;
const FRAME_S = 0.08;
const AHEAD_MS = 300;
/** A microphone that is held elsewhere may be given and yet hear nothing. */
const SOUND_PATIENCE_MS = 5000;
/** Without a chirp by then, motion is timed as if sound took no time. */
const LATENCY_PATIENCE_S = 6;
/** Until the last chirp has been heard whole. */
const TAIL_MS = 400;
/** What is kept behind a direct arrival. */
const BEHIND_S = 0.075;
/** So many arrivals tell how long sound takes through the phone by now. */
const RECENT = 5;
/** Chirps of a second: so many are lost in each in which none is heard. */
const CHIRPS_A_SECOND = 10;
const LEAST_STEP_S = 1e-4;
const CHIRPS_HEADER = "t_s,gain_db\n";
const CHECKPOINTS_HEADER = "t_s,name,x_m,y_m\n";

/**
 * @typedef {import("./manifest.js").Facts} Facts
 * @typedef {import("./sending.js").Sent} Sent
 * @typedef {import("./storage_client.js").StorageClient} StorageClient
 * @typedef {import("./devices.js").Sound} Sound
 * @typedef {import("../stages/hearing.js").MediumAccessParameters} MediumAccessParameters
 * @typedef {{slot: number, start: number, played: number | null, gainDb: number}} Slot frames of the clock
 * @typedef {{pageMs: number, acceleration: number[] | null, turning: number[] | null}} Reading
 */

/**
 * Motion on the recording's clock, held back until it is known how long sound takes through the phone.
 * @param {(tS: number, acceleration: number[]) => void} onReading
 * @param {number} [sinceS] what came before that is left out
 */
export function makeMotionLog(onReading, sinceS = 0) {
  /** @type {Reading[]} */
  let waiting = [];
  let last = { acceleration: -Infinity, turning: -Infinity };
  /** @param {"acceleration" | "turning"} kind @param {number} tS @param {number[] | null} values */
  const row = (kind, tS, values) => {
    if (values === null || tS < Math.max(last[kind] + LEAST_STEP_S, sinceS)) return "";
    last = { ...last, [kind]: tS };
    return tableRow(tS, values);
  };
  return {
    /** @param {number} pageMs @param {number[] | null} acceleration @param {number[] | null} turning */
    add: (pageMs, acceleration, turning) => waiting.push({ pageMs, acceleration, turning }),
    /**
     * Rows of both tables up to now; those later than `untilS` wait.
     * @param {(pageMs: number) => number} timeOf
     */
    take: (timeOf, untilS = Infinity) => {
      const rows = { "accelerometer.csv": "", "gyroscope.csv": "" };
      /** @param {Reading} reading */
      const isLater = ({ pageMs }) => timeOf(pageMs) > untilS;
      for (const { pageMs, acceleration, turning } of waiting.filter((each) => !isLater(each))) {
        const tS = timeOf(pageMs);
        rows["accelerometer.csv"] += row("acceleration", tS, acceleration);
        rows["gyroscope.csv"] += row("turning", tS, turning);
        if (acceleration) onReading(tS, acceleration);
      }
      waiting = waiting.filter(isLater);
      return rows;
    },
  };
}

/**
 * Records a segment of a walk, until it is paused. One that goes on after an interruption does so at `fromS` of the
 * walk's own time: what lies between is missing, and nothing before it is touched.
 * @param {{
 *   microphone: import("./microphone.js").Microphone, sound: Sound,
 *   storage: StorageClient, clocks: ReturnType<typeof import("./clocks.js").watchClocks>,
 *   play: (delayS: number, tell: (slot: Slot) => void) => ReturnType<typeof import("./devices.js").startSlots>,
 *   mediumAccess: MediumAccessParameters, latencyS: number | null,
 *   sent: Sent, heard: (peak: number, isFound: boolean) => void, fromS?: number,
 * }} given
 * @returns {Promise<Segment>}
 * @typedef {{pause: () => Promise<void>, flush: () => Promise<void>, mark: (marked: Marked) => void}} Segment
 *   flush: keeps what has come by now; mark: the walker is at a place
 * @typedef {{name: string, pageMs: number, xyM: [number, number] | null}} Marked xyM: on the plan that was tapped
 */
export async function startWalking(given) {
  const { microphone, sound, storage, clocks, play, mediumAccess, latencyS, sent, heard, fromS = 0 } = given;
  const { state, walk } = sent;
  const rateHz = microphone.context.sampleRate;
  /** @param {Record<string, string>} texts by file */
  const keep = (texts) => storage.ask(appendOrder(walk, texts));
  await sent.save();

  let steps = { ...NO_STEPS, count: state.facts.steps };
  const log = makeMotionLog((tS, acceleration) => {
    steps = countStep(steps, tS, acceleration);
    state.facts.steps = steps.count;
  }, fromS);
  // Motion is heard a little ahead of the sound, which takes its time through the phone.
  const stopMotion = listenToMotion(log.add);
  await pause(AHEAD_MS);
  const zero = await beginSound(sound, sent, mediumAccess, latencyS, fromS).catch((error) => {
    stopMotion();
    throw error;
  });
  const chirpLog = makeChirpLog(zero, rateHz);
  const chirps = play(FIRST_CHIRP_S, (slot) => {
    sound.order({ do: "slot", slot });
    if (slot.played !== null) chirpLog.add(slot.played, slot.gainDb);
  });
  sound.on("heard", ({ slot, othersS, played }) => {
    state.facts.others += othersS.length;
    chirps.heard(slot, othersS, played);
  });
  sound.on("gap", ({ tS, lostS }) => state.facts.gaps.push({ t_s: tS, lost_s: lostS }));
  const late = makeLateness();
  let keptUntilS = 0;
  sound.on("frame", (frame) => {
    noteFrame(state.facts, frame);
    if (frame.isFound) late.add(frame.directS, frame.lateS);
    keptUntilS = frame.tS + FRAME_S;
    state.facts.latencyS ??= late.latencyS();
    heard(frame.peak, frame.isFound);
  });

  /** @type {Marked[]} */
  let marked = [];
  // Motion is kept as far as the sound is: what comes later waits.
  const soundUntilS = () => Math.max(late.endS() ?? -Infinity, keptUntilS);
  let limit = Infinity;
  /** @param {boolean} isLast motion waits for no sound any more */
  const write = async (isLast) => {
    const begun = chirpLog.take(Math.min(microphone.context.currentTime * rateHz, limit));
    if (begun !== "") await keep({ [CHIRPS]: (sent.sizes[CHIRPS] ? "" : CHIRPS_HEADER) + begun });
    const isKnown = late.latencyS() !== null;
    if (!isKnown && !isLast && !(state.facts.seconds - fromS > LATENCY_PATIENCE_S)) return;
    const line = clocks.line();
    const lateS = (late.latencyS() ?? 0) - zero / rateHz;
    /** @param {number} pageMs */
    const timeOf = (pageMs) => soundTime(line, pageMs) + lateS;
    const rows = { ...log.take(timeOf, isKnown ? soundUntilS() : Infinity), [CHECKPOINTS]: checkpointRows(marked, timeOf) };
    marked = [];
    const texts = Object.entries(rows).filter(([, text]) => text !== "");
    if (texts.length === 0) return;
    await keep(Object.fromEntries(texts.map(([name, text]) => [name, (sent.sizes[name] ? "" : headerOf(name)) + text])));
  };
  /** @type {Promise<void>} */
  let last = Promise.resolve();
  // One at a time: whoever comes first writes the header.
  const flush = (isLast = false) => {
    const done = last.then(() => write(isLast));
    last = done.catch(() => {});
    return done;
  };
  const timer = everySecond(microphone.context, zero, sent, storage, () => {
    const isUnheard = late.endS() === undefined && keptUntilS === 0 && state.facts.seconds - fromS > LATENCY_PATIENCE_S;
    for (let k = 0; isUnheard && k < CHIRPS_A_SECOND; k += 1) heard(0, false);
    return flush();
  });

  const pauseLeg = async () => {
    limit = chirps.stop();
    await pause(1000 * (late.latencyS() ?? 0) + TAIL_MS);
    stopMotion();
    clearInterval(timer);
    const stopped = sound.answer("stopped");
    sound.order({ do: "stop" });
    const { seconds, sizes } = await stopped;
    state.facts.seconds = seconds;
    await flush(true).catch(() => {}); // a full phone keeps what it has
    await untilKept(sent, sizes);
    await sent.save().catch(() => {});
  };
  return { pause: pauseLeg, flush: () => flush(), mark: (one) => marked.push(one) };
}

/** @param {string} table */
function headerOf(table) {
  return table === CHECKPOINTS ? CHECKPOINTS_HEADER : TABLE_HEADER;
}

/**
 * A row for each place that the walker has marked; a name may hold commas and quotes.
 * @param {Marked[]} marked @param {(pageMs: number) => number} timeOf
 */
export function checkpointRows(marked, timeOf) {
  const row = (/** @type {Marked} */ { name, pageMs, xyM }) => {
    const tapped = (xyM ?? ["", ""]).map((metres) => (metres === "" ? "" : Number(metres).toFixed(3)));
    return `${Math.max(timeOf(pageMs), 0).toFixed(3)},"${name.replaceAll('"', '""')}",${tapped.join(",")}\n`;
  };
  return marked.map(row).join("");
}

/**
 * Nothing more is added: the manifest is written, and the walk may be finished by any page.
 * @param {Sent} sent @param {StorageClient} storage @param {string} software
 */
export async function closeWalk(sent, storage, software) {
  const order = appendOrder(sent.walk, { "recording.json": manifestOf(sent.state, software) });
  sent.sizes["recording.json"] = order.parts[0][1].length;
  await sent.save(0);
  await storage.ask(order);
  sent.state.isOver = true;
  await sent.save();
}

/**
 * @param {string} walk @param {Record<string, string>} texts by file: all of them are kept, or none
 * @returns {{do: "append", walk: string, parts: [string, Uint8Array][]}}
 */
function appendOrder(walk, texts) {
  const encoder = new TextEncoder();
  return { do: "append", walk, parts: Object.entries(texts).map(([name, text]) => [name, encoder.encode(text)]) };
}

/**
 * @param {Sound} sound @param {Sent} sent @param {MediumAccessParameters} mediumAccess
 * @param {number | null} latencyS @param {number} fromS
 * @returns {Promise<number>} the frame of the clock at which the recording began, or would have. Raises Problem
 */
async function beginSound(sound, { walk, state, sizes }, mediumAccess, latencyS, fromS) {
  const started = sound.answer("started");
  sound.order({ do: "record", walk, kind: state.kind, mediumAccess, latencyS, fromS, kept: { ...sizes } });
  const begun = await Promise.race([started, pause(SOUND_PATIENCE_MS)]);
  if (begun) return begun.zero;
  sound.order({ do: "stop" });
  throw new Problem(t("The microphone gives no sound. End the call or the app that holds it, and try again."), 0);
}

/** @param {Facts} facts @param {{tS: number, jumpedS: number, isFound: boolean}} frame */
function noteFrame(facts, { tS, jumpedS, isFound }) {
  facts.frames += 1;
  if (!isFound) facts.missed += 1;
  if (jumpedS !== 0) facts.jumps.push({ t_s: tS, by_s: jumpedS });
}

/**
 * When chirps were played, and how loud, as rows of their table.
 * @param {number} zero frame of the clock at which the recording began
 * @param {number} rateHz
 */
export function makeChirpLog(zero, rateHz) {
  /** @type {{frame: number, gainDb: number}[]} */
  let chirps = [];
  return {
    /** @param {number} frame @param {number} gainDb */
    add: (frame, gainDb) => chirps.push({ frame, gainDb }),
    /** Rows of those that began before a frame of the clock. @param {number} before */
    take: (before) => {
      const begun = chirps.filter(({ frame }) => frame < before);
      chirps = chirps.filter(({ frame }) => frame >= before);
      return begun.map(({ frame, gainDb }) => `${((frame - zero) / rateHz).toFixed(9)},${gainDb}\n`).join("");
    },
  };
}

/**
 * How long sound takes from playing to hearing, followed from chirp to chirp: it jumps where the browser
 * loses sound.
 */
export function makeLateness() {
  /** @type {number[]} */
  let recent = [];
  /** @type {number | null} */
  let lastS = null;
  /** @param {number} directS @param {number | null} lateS null where nobody told when the chirp was played */
  const add = (directS, lateS) => {
    if (lateS !== null) recent = [...recent, lateS].slice(-RECENT);
    lastS = directS;
  };
  return {
    add,
    latencyS: () => (recent.length > 0 ? median(recent) : null),
    endS: () => (lastS === null ? undefined : lastS + BEHIND_S),
  };
}

/**
 * @param {AudioContext} context @param {number} zero frame of the clock at which the recording began
 * @param {Sent} sent @param {StorageClient} storage @param {() => Promise<void>} tick
 */
function everySecond(context, zero, sent, storage, tick) {
  let count = 0;
  return setInterval(async () => {
    sent.state.facts.seconds = context.currentTime - zero / context.sampleRate;
    count += 1;
    try {
      await tick();
      if (count % SAVE_EVERY !== 0) return;
      await sent.save();
      await storage.ask({ do: "flush", walk: sent.walk }); // an empty battery leaves what is on the disk
    } catch {
      // The storage has told the page, which ends the walk.
    }
  }, FLUSH_EVERY_MS);
}

/** @param {Sent} sent @param {Record<string, number>} sizes */
async function untilKept(sent, sizes) {
  const isKept = () => Object.entries(sizes).every(([name, size]) => (sent.sizes[name] ?? 0) >= size);
  for (let k = 0; k < 100 && !isKept(); k += 1) await pause(50);
}

/** @param {number} milliseconds @returns {Promise<void>} */
function pause(milliseconds) {
  return new Promise((resolve) => setTimeout(resolve, milliseconds));
}

/** The segments of a walk: recorded, paused by whatever takes the sound or the page away, gone on with, ended. */

/** After so long a pause nobody knows any more where the walker is: the walk is sent as it is. */
const MOST_PAUSE_S = 600;
/** A segment begins so much later than what was kept before it, at the least. */
const LEAST_PAUSE_S = 1;

/**
 * @typedef {import("./manifest.js").Walk} Walk
 * @typedef {{isGoing: () => boolean, goOn: () => Promise<void>, pause: () => Promise<void>,
 *   flush: () => Promise<void>, mark: (marked: Marked) => void, end: () => Promise<void>}} Segments
 *   each takes its turn: two events at once do no harm
 */

/** When a walk goes on that was kept so far, on its own clock, s. @param {Walk} state @param {number} nowMs */
export function goesOnAt({ startUtc, facts }, nowMs) {
  return Math.max((nowMs - Date.parse(startUtc)) / 1000, facts.seconds + LEAST_PAUSE_S);
}

/** Whether a walk that was broken off may still go on. @param {Walk} state @param {number} nowMs */
export function mayGoOn(state, nowMs) {
  return !state.isOver && goesOnAt(state, nowMs) - state.facts.seconds < MOST_PAUSE_S;
}

/**
 * @param {Walk} state
 * @param {{begin: (fromS: number) => Promise<Segment>, close: () => Promise<void>, nowMs: () => number}} given begin:
 *   records from that time of the walk on; close: nothing more is added
 * @returns {Segments}
 */
export function makeSegments(state, { begin, close, nowMs }) {
  /** @type {Segment | null} */
  let segment = null;
  let isBegun = false;
  let isOver = false;
  /** @type {Promise<unknown>} */
  let last = Promise.resolve();
  /** @param {() => Promise<void>} work @returns {Promise<void>} */
  const inTurn = (work) => {
    const done = last.then(work);
    last = done.catch(() => {});
    return done;
  };

  const goOn = async () => {
    if (segment || isOver) return;
    const keptS = state.facts.seconds;
    const fromS = isBegun || keptS > 0 ? goesOnAt(state, nowMs()) : 0;
    segment = await begin(fromS);
    isBegun = true;
    if (fromS > 0) state.facts.gaps.push({ t_s: keptS, lost_s: fromS - keptS });
  };

  const pause = async () => {
    const paused = segment;
    segment = null;
    await paused?.pause();
  };

  const end = async () => {
    if (isOver) return;
    isOver = true;
    await pause();
    await close();
  };

  return {
    isGoing: () => segment !== null,
    goOn: () => inTurn(goOn),
    pause: () => inTurn(pause),
    flush: async () => segment?.flush(),
    mark: (marked) => segment?.mark(marked),
    end: () => inTurn(end),
  };
}

/** A walk on its way: what the page shows meanwhile, and what it does when the walk is interrupted. */

import { Problem } from "../shared/api.js";
import { formatDuration } from "../shared/format.js";
import { locale, t } from "../shared/words.js";
import { stayAwake } from "./devices.js";
import { startSending } from "./finishing.js";
import { showMarks, showNoSketch, startGrowing } from "./growing/growing.js";
import { openTapping } from "./growing/tapping.js";
import { closeWalk, startWalking, makeSegments } from "./walking.js";
import { at, showChirps, showFacts, showLevel, showNetwork, showPause, totalBytes } from "./view.js";

const SHOW_EVERY_MS = 500;
/** A page whose timers stood still for so long was asleep. */
const ASLEEP_MS = 2500;

/**
 * @typedef {import("./sending.js").Sent} Sent
 * @typedef {ReturnType<typeof startSending>} Sending
 * @typedef {{
 *   storage: import("./storage_client.js").StorageClient, software: () => string,
 *   mediumAccess: () => import("../stages/hearing.js").MediumAccessParameters,
 *   devices: () => Promise<import("./devices.js").Devices>, latencyS: () => number | null,
 *   finish: (sent: Sent, sending: Sending) => Promise<void>,
 *   act: (work: () => unknown) => (event?: Event) => Promise<void>,
 * }} Given devices: those of this phone, opened anew where they were taken away
 */

/** @param {Given} given */
export function makeRecordingController(given) {
  const { storage, finish } = given;
  /**
   * @type {{sent: Sent, segments: import("./walking.js").Segments, sending: Sending, growing: ReturnType<typeof startGrowing>,
   *   leave: () => void} | null}
   */
  let now = null;
  /** @type {import("./growing/tapping.js").Tapping | null} */
  let tapping = null;

  /** @param {Sent} sent @param {ReturnType<typeof startGrowing>} growing */
  const segmentsOf = (sent, growing) => makeSegments(sent.state, {
    begin: (fromS) => beginLeg(given, sent, growing, fromS),
    close: () => closeWalk(sent, storage, given.software()),
    nowMs: () => Date.now(),
  });

  /** A new walk, or one that an earlier page left behind. @param {Sent} sent */
  async function start(sent) {
    showNoSketch();
    const growing = startGrowing();
    const segments = segmentsOf(sent, growing);
    showPause(null);
    await segments.goOn().catch((error) => {
      growing.leave();
      throw error;
    });
    const sending = startSending(sent, storage);
    now = { sent, segments, sending, growing, leave: watchWalk(sent, sending, segments) };
    showMarks(sent.state.marks ?? [], again);
    tapping = await openTapping(sent.state, given.act).catch(() => null); // a walk needs no plan
  }

  /** @param {string} name */
  const again = (name) => given.act(() => mark(name))();

  /** The walker stands at a place that has a name, for the first time or again. @param {string} name */
  function mark(name) {
    if (!now?.segments.isGoing()) throw new Problem(t("Nothing is recorded at this moment. Go on walking, then mark the place."), 0);
    const { sent: { state }, segments, growing } = now;
    const pageMs = performance.now();
    state.marks = [...new Set([...(state.marks ?? []), name])];
    tapping?.keep(name);
    segments.mark({ name, pageMs, xyM: state.taps?.[name] ?? null });
    growing.mark(name, pageMs);
    showMarks(state.marks, again);
  }

  /** Nothing is recorded from now on, and the page says so at once. @param {string} why */
  async function interrupt(why) {
    if (!now?.segments.isGoing()) return;
    showPause(`${why} ${t("Nothing is recorded until the walk goes on; what was recorded is kept.")}`, true);
    await now.segments.pause();
  }

  async function goOn() {
    if (!now) return;
    await now.segments.goOn();
    showPause(null);
  }

  /** Where nothing was tapped nothing is said when it does not work: the button is still there. */
  async function goOnIfPossible() {
    if (now && !now.segments.isGoing()) await goOn().catch(() => {});
  }

  /** The microphone hears nothing, and motion goes on. @param {boolean} isSilent */
  function silent(isSilent) {
    if (!now?.segments.isGoing()) return;
    showPause(isSilent ? t("The microphone is silent, as in a call. The walk goes on by its steps until it hears again.") : null);
  }

  async function end() {
    if (!now) return;
    const { sent, segments, sending, growing, leave } = now;
    now = null;
    await segments.end();
    leave();
    tapping?.leave();
    tapping = null;
    growing.leave();
    await finish(sent, sending);
  }

  return {
    start, interrupt, goOn, goOnIfPossible, silent, mark, end,
    isOn: () => now !== null,
    isPaused: () => now !== null && !now.segments.isGoing(),
  };
}

/** @param {Given} given @param {Sent} sent @param {ReturnType<typeof startGrowing>} growing @param {number} fromS */
async function beginLeg(given, sent, growing, fromS) {
  const devices = await given.devices();
  const { microphone, sound, clocks, playSlots } = devices;
  const { context } = microphone;
  if (context.sampleRate !== sent.state.rateHz) {
    const [now, before] = [context.sampleRate, sent.state.rateHz].map((rateHz) => `${(rateHz / 1000).toLocaleString(locale)} kHz`);
    throw new Problem(t("The sound runs at {{now}} now and ran at {{before}} before: send the walk as it is.", { now, before }), 0);
  }
  // Sound may have been opened before the server had said how the air is shared.
  const mediumAccess = given.mediumAccess();
  const chirps = makeChirpWatch(() => microphone.track.getSettings(), navigator.userAgent);
  showChirps(null);
  const drawn = growing.segment(devices);
  const segment = await startWalking({
    microphone, sound, clocks, mediumAccess, sent, fromS, storage: given.storage,
    heard: (peak, isFound) => {
      showLevel(peak, isFound);
      showChirps(chirps(peak, isFound));
    },
    latencyS: given.latencyS() ?? sent.state.facts.latencyS,
    play: (delayS, tell) => playSlots(delayS, (slot) => {
      drawn.slot(slot);
      tell(slot);
    }, mediumAccess),
  }).catch((error) => {
    drawn.end();
    throw error;
  });
  return { ...segment, pause: () => segment.pause().finally(drawn.end) };
}

/**
 * Shows a walk as it goes, and says when the page was asleep. Gives what ends that.
 * @param {Sent} sent @param {Sending} sending @param {import("./walking.js").Segments} segments
 */
function watchWalk(sent, sending, segments) {
  const awake = stayAwake(at("awake"));
  let shownMs = performance.now();
  const show = () => {
    const nowMs = performance.now();
    if (nowMs - shownMs > ASLEEP_MS && segments.isGoing()) sayAsleep((nowMs - shownMs) / 1000);
    shownMs = nowMs;
    showFacts(sent.state.facts, totalBytes(sent.sizes), totalBytes(sending.progress.sent));
    showNetwork(sending.progress.trouble, sent.state.recording !== null);
  };
  let hiddenMs = 0;
  const turned = () => {
    if (document.hidden) {
      hiddenMs = performance.now();
      segments.flush().catch(() => {});
    } else if (segments.isGoing() && performance.now() - hiddenMs > ASLEEP_MS) {
      sayAsleep((performance.now() - hiddenMs) / 1000);
    }
  };
  show();
  const timer = setInterval(show, SHOW_EVERY_MS);
  document.addEventListener("visibilitychange", turned);
  sending.done.catch((error) => showNetwork(error.message, false));
  return () => {
    clearInterval(timer);
    document.removeEventListener("visibilitychange", turned);
    awake.stop();
    showPause(null);
  };
}

/** @param {number} seconds */
function sayAsleep(seconds) {
  showPause(t("This page was asleep for {{time}}: steps are missing there. The walk goes on.", { time: formatDuration(seconds) }));
}

// What is wrong with the chirps while a walk is recorded, and what to do about it on this phone. Pure.

/** Two seconds of chirps are judged together: one that is lost says nothing. */
const WINDOW = 20;
const HEARD_SHARE = 0.5;
/** Of full scale, as the check before the walk has them. */
const SOFT = 0.004;
const HARDLY = 0.0005;
/** A quarter of what it was at its best: the phone has begun to work on the sound, or something covers it. */
const FADED = 0.25;
/** Settings of the microphone that must be off, as far as browsers may switch them on by themselves. */
const DISTORTIONS = ["echoCancellation", "noiseSuppression", "autoGainControl"];

/**
 * Judges each chirp with those before it; gives what to say, null where all is well or too little was heard yet.
 * @param {() => MediaTrackSettings} settings of the microphone at this moment
 * @param {string} userAgent
 * @returns {(peak: number, isFound: boolean) => string | null}
 */
export function makeChirpWatch(settings, userAgent) {
  /** @type {{peak: number, isFound: boolean}[]} */
  let recent = [];
  let best = 0;
  return (peak, isFound) => {
    recent = [...recent, { peak, isFound }].slice(-WINDOW);
    if (recent.length < WINDOW) return null;
    const found = recent.filter((each) => each.isFound).map((each) => each.peak).sort((one, other) => one - other);
    const level = found[found.length >> 1] ?? 0;
    best = Math.max(best, level);
    return wrongWith(settings()) ?? tooSoft(found.length / WINDOW, level, best, louderOn(userAgent));
  };
}

/** @param {Record<string, any>} settings */
function wrongWith(settings) {
  const isOn = DISTORTIONS.some((key) => settings[key] === true || typeof settings[key] === "string");
  return isOn ? t("The browser has begun to work on the sound, which wipes out the chirps. End a call that uses the microphone, or use another browser.") : null;
}

/** @param {number} heardShare @param {number} level @param {number} best @param {string} louder */
function tooSoft(heardShare, level, best, louder) {
  if (heardShare < HEARD_SHARE) return t("The chirps are not heard. {{louder}} Uncover loudspeaker and microphone.", { louder });
  if (level < HARDLY) return t("The chirps are hardly heard. {{louder}}", { louder });
  if (level < FADED * best) {
    return t("The chirps have become much softer. Uncover loudspeaker and microphone, and look at the volume. If that does not help, this browser takes them for noise: use another one.");
  }
  return level < SOFT ? t("The chirps are soft. {{louder}}", { louder }) : null;
}

/** How to turn chirps up on this phone. @param {string} userAgent */
export function louderOn(userAgent) {
  if (/iPhone|iPad|iPod/.test(userAgent)) return t("Press the volume button now, and switch the silent mode off.");
  if (/Android/.test(userAgent)) return t("Press the volume button now, and turn up “media”.");
  return t("Turn the volume up.");
}

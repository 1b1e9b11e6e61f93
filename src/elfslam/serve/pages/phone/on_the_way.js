/** A walk on its way: what the page shows meanwhile, and what it does when the walk is interrupted. */

import { Problem } from "../shared/api.js";
import { formatDuration } from "../shared/format.js";
import { makeChirpWatch } from "./chirp_watch.js";
import { startSending } from "./finishing.js";
import { startGrowing } from "./growing/growing.js";
import { showMarks, showNoSketch } from "./growing/growing_view.js";
import { openTapping } from "./growing/tapping.js";
import { makeLegs } from "./legs.js";
import { closeWalk, startWalking } from "./walking.js";
import { stayAwake } from "./wake.js";
import { at, showChirps, showFacts, showLevel, showNetwork, showPause, totalBytes } from "./view.js";
import { locale, t } from "../shared/words.js";

const SHOW_EVERY_MS = 500;
/** A page whose timers stood still for so long was asleep. */
const ASLEEP_MS = 2500;

/**
 * @typedef {import("./sending.js").Sent} Sent
 * @typedef {ReturnType<typeof startSending>} Sending
 * @typedef {{
 *   keeper: import("./keeper.js").Keeper, software: () => string,
 *   mediumAccess: () => import("../stages/medium_access.js").MediumAccessParameters,
 *   devices: () => Promise<import("./devices.js").Devices>, latencyS: () => number | null,
 *   finish: (sent: Sent, sending: Sending) => Promise<void>,
 *   act: (work: () => unknown) => (event?: Event) => Promise<void>,
 * }} Given devices: those of this phone, opened anew where they were taken away
 */

/** @param {Given} given */
export function makeOnTheWay(given) {
  const { keeper, finish } = given;
  /**
   * @type {{sent: Sent, legs: import("./legs.js").Legs, sending: Sending, growing: ReturnType<typeof startGrowing>,
   *   leave: () => void} | null}
   */
  let now = null;
  /** @type {import("./growing/tapping.js").Tapping | null} */
  let tapping = null;

  /** @param {Sent} sent @param {ReturnType<typeof startGrowing>} growing */
  const legsOf = (sent, growing) => makeLegs(sent.state, {
    begin: (fromS) => beginLeg(given, sent, growing, fromS),
    close: () => closeWalk(sent, keeper, given.software()),
    nowMs: () => Date.now(),
  });

  /** A new walk, or one that an earlier page left behind. @param {Sent} sent */
  async function start(sent) {
    showNoSketch();
    const growing = startGrowing();
    const legs = legsOf(sent, growing);
    showPause(null);
    await legs.goOn().catch((error) => {
      growing.leave();
      throw error;
    });
    const sending = startSending(sent, keeper);
    now = { sent, legs, sending, growing, leave: watchWalk(sent, sending, legs) };
    showMarks(sent.state.marks ?? [], again);
    tapping = await openTapping(sent.state, given.act).catch(() => null); // a walk needs no plan
  }

  /** @param {string} name */
  const again = (name) => given.act(() => mark(name))();

  /** The walker stands at a place that has a name, for the first time or again. @param {string} name */
  function mark(name) {
    if (!now?.legs.isGoing()) throw new Problem(t("Nothing is recorded at this moment. Go on walking, then mark the place."), 0);
    const { sent: { state }, legs, growing } = now;
    const pageMs = performance.now();
    state.marks = [...new Set([...(state.marks ?? []), name])];
    tapping?.keep(name);
    legs.mark({ name, pageMs, xyM: state.taps?.[name] ?? null });
    growing.mark(name, pageMs);
    showMarks(state.marks, again);
  }

  /** Nothing is recorded from now on, and the page says so at once. @param {string} why */
  async function interrupt(why) {
    if (!now?.legs.isGoing()) return;
    showPause(`${why} ${t("Nothing is recorded until the walk goes on; what was recorded is kept.")}`, true);
    await now.legs.pause();
  }

  async function goOn() {
    if (!now) return;
    await now.legs.goOn();
    showPause(null);
  }

  /** Where nothing was tapped nothing is said when it does not work: the button is still there. */
  async function goOnIfPossible() {
    if (now && !now.legs.isGoing()) await goOn().catch(() => {});
  }

  /** The microphone hears nothing, and motion goes on. @param {boolean} isSilent */
  function silent(isSilent) {
    if (!now?.legs.isGoing()) return;
    showPause(isSilent ? t("The microphone is silent, as in a call. The walk goes on by its steps until it hears again.") : null);
  }

  async function end() {
    if (!now) return;
    const { sent, legs, sending, growing, leave } = now;
    now = null;
    await legs.end();
    leave();
    tapping?.leave();
    tapping = null;
    growing.leave();
    await finish(sent, sending);
  }

  return {
    start, interrupt, goOn, goOnIfPossible, silent, mark, end,
    isOn: () => now !== null,
    isPaused: () => now !== null && !now.legs.isGoing(),
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
  const drawn = growing.leg(devices);
  const leg = await startWalking({
    microphone, sound, clocks, mediumAccess, sent, fromS, keeper: given.keeper,
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
  return { ...leg, pause: () => leg.pause().finally(drawn.end) };
}

/**
 * Shows a walk as it goes, and says when the page was asleep. Gives what ends that.
 * @param {Sent} sent @param {Sending} sending @param {import("./legs.js").Legs} legs
 */
function watchWalk(sent, sending, legs) {
  const awake = stayAwake(at("awake"));
  let shownMs = performance.now();
  const show = () => {
    const nowMs = performance.now();
    if (nowMs - shownMs > ASLEEP_MS && legs.isGoing()) sayAsleep((nowMs - shownMs) / 1000);
    shownMs = nowMs;
    showFacts(sent.state.facts, totalBytes(sent.sizes), totalBytes(sending.progress.sent));
    showNetwork(sending.progress.trouble, sent.state.recording !== null);
  };
  let hiddenMs = 0;
  const turned = () => {
    if (document.hidden) {
      hiddenMs = performance.now();
      legs.flush().catch(() => {});
    } else if (legs.isGoing() && performance.now() - hiddenMs > ASLEEP_MS) {
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

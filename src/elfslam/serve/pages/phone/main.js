/**
 * The phone page, from the first tap to the map. What the first views do not need is loaded behind them: on a slow
 * phone a tap does something before all of it is there.
 */

import { Problem, ask, openSession, pairWith } from "../shared/api.js";
import { languageChoice, t } from "../shared/words.js";
import { MEDIUM_ACCESS } from "../stages/constants.js";
import { CHIRP } from "../stages/chirp.js";
import { TRIAL, openDevices, probeSound } from "./devices.js";
import { hasLinks, openShared } from "./guest.js";
import {
  askDiscard, at, parseStart, showChecks, showListening, showMicrophones, showProblem, showTrying, showUnfinished,
  showView, usualName, walkKey,
} from "./view.js";
import { startStorage } from "./storage_client.js";
import { describeDevice, NO_FACTS } from "./manifest.js";
import { chooseByHand, chooseMicrophone, describeEars, resume, watchInterruptions } from "./microphone.js";
import { describeMotion, listenToMotion } from "./motion.js";
import { judge, summarise } from "./verdicts.js";

const WITHOUT_SERVER =
  t("The server does not answer. The maps on this phone work without it, and a walk is kept until it is back.");

/** Of a simulated walker, for who is in a hurry. */
const FAST = 4;

const storage = startStorage();
/**
 * @typedef {import("./devices.js").Devices & {measured: import("./probe.js").Measured | null,
 *   choice: import("./microphone.js").Choice | null}} Phone
 * @typedef {{speed: number, who: "walk" | "other"}} Simulated
 * @typedef {import("./sending.js").Sent} Sent
 * @typedef {ReturnType<typeof import("./finishing.js").startSending>} Sending
 */

/**
 * What the page knows; `phone` is there once sound and motion are allowed.
 * @type {{
 *   chirp: import("../stages/chirp.js").Chirp, software: string, phone: Phone | null, walks: Sent[],
 *   mediumAccess: import("../stages/hearing.js").MediumAccessParameters,
 *   current?: Sent, sending?: Sending, begun?: Promise<void>, isGuest: boolean, simulated: Simulated | null,
 * }} current: the walk that is shown; isGuest: a link brought somebody here; simulated: instead of this phone
 */
const page = { chirp: CHIRP, mediumAccess: MEDIUM_ACCESS, software: "elfslam", phone: null, walks: [], isGuest: false, simulated: null };

/**
 * Runs what a tap starts; what goes wrong is said in one line.
 * @param {() => unknown} work @returns {(event?: Event) => Promise<void>}
 */
function act(work) {
  return async (event) => {
    event?.preventDefault();
    const button = /** @type {HTMLButtonElement | null | undefined} */ (
      /** @type {SubmitEvent | undefined} */ (event)?.submitter ?? event?.currentTarget
    );
    if (button) button.disabled = true;
    showProblem(null);
    try {
      await work();
    } catch (error) {
      showProblem(/** @type {Error} */ (error).message);
      if (!(error instanceof Problem || error instanceof RangeError)) console.error(error);
    } finally {
      if (button) button.disabled = false;
    }
  };
}

async function begin() {
  const clearing = clearUp();
  try {
    page.isGuest = await openShared(window.location, window.history);
    await openSession(window.location, window.history);
    const { version, chirp, medium_access: mediumAccess } = await ask("GET", "/api/version");
    page.software = `elfslam ${version}, phone page`;
    if (chirp) page.chirp = only(chirp, Object.keys(CHIRP));
    if (mediumAccess) page.mediumAccess = only(mediumAccess, Object.keys(MEDIUM_ACCESS));
    await ask("GET", "/api/me");
  } catch (error) {
    const { status } = /** @type {Problem} */ (error);
    const isAway = status === 0;
    const isGuest = status === 401 && (page.isGuest || (await hasLinks()));
    at("pair").hidden = isGuest || status !== 401;
    if (!isGuest) showProblem(isAway ? WITHOUT_SERVER : /** @type {Error} */ (error).message, isAway ? "doubt" : "fail");
  }
  await clearing;
}

/** @template T @param {T} values @param {string[]} names @returns {T} without what has another name */
function only(values, names) {
  return /** @type {T} */ (Object.fromEntries(names.map((name) => [name, values[/** @type {keyof T} */ (name)]])));
}

function listUnfinished() {
  showUnfinished(page.walks, { goOn: goOnWith, send: continueSending, discard: discardWalk }, Date.now());
}

/** Looks for walks that an earlier page left behind. */
async function clearUp() {
  try {
    const { findUnfinished } = await import("./finishing.js");
    page.walks = await findUnfinished(storage);
    listUnfinished();
  } catch (error) {
    showProblem(/** @type {Error} */ (error).message);
  }
}

/** With an address that somebody pasted. */
async function pairByHand() {
  await pairWith(/** @type {HTMLInputElement} */ (at("pair-address")).value);
  window.location.reload();
}

async function allow() {
  if (page.simulated) forgetPhone(null);
  await openPhone();
  await probe();
}

/** Sound and motion, opened once, and anew where a call keeps the sound. Must be called from a tap. @returns {Promise<Phone>} */
async function openPhone() {
  if (page.phone && (await resume(page.phone.microphone.context))) return page.phone;
  page.phone?.microphone.close();
  if (page.simulated) return openSimulated(page.simulated);
  page.phone = { ...(await openDevices(storage, page.chirp, page.mediumAccess)), measured: null, choice: null };
  watchForInterruptions(page.phone);
  navigator.storage?.persist?.();
  return page.phone;
}

/** @param {Simulated} simulated @returns {Promise<Phone>} */
async function openSimulated({ who, speed }) {
  const { fetchWalk, simulatedDevices } = await import("./simulated_walker.js");
  const walked = await fetchWalk(who);
  const devices = simulatedDevices(walked, speed, storage, page.chirp, () => {
    if (loaded.recording?.isOn()) stop();
    loaded.locating?.stopFor(t("The simulated walk is over."), "wait");
  });
  page.phone = { ...devices, measured: null, choice: null };
  return page.phone;
}

/** Another one is opened next. @param {Simulated | null} simulated */
function forgetPhone(simulated) {
  page.simulated = simulated;
  page.phone?.microphone.close();
  page.phone = null;
}

/** Who has no phone watches a simulated walker: one who maps a lounge, or somebody else who is looked for in it. */
async function simulate() {
  const isFast = /** @type {HTMLInputElement} */ (at("simulated-fast")).checked;
  forgetPhone({ who: "walk", speed: isFast ? FAST : 1 });
  at("walk-name").value = t("A simulated walk");
  await walk();
}

/** Once the phone is opened. */
async function probe() {
  const phone = /** @type {Phone} */ (page.phone);
  const { microphone, sound, play } = phone;
  const periodS = page.chirp.period_s;
  showView("probe");
  showListening();
  phone.choice = await chooseMicrophone(microphone, () => probeSound(sound, play, periodS, TRIAL), showTrying);
  showListening();
  /** @type {number[]} */
  const times = [];
  /** @type {number[][]} */
  const accelerations = [];
  const stop = listenToMotion((pageMs, acceleration) => {
    if (acceleration === null) return;
    times.push(pageMs);
    accelerations.push(acceleration);
  });
  const measured = await probeSound(sound, play, periodS);
  phone.measured = measured;
  stop();
  const motion = describeMotion(times, accelerations);
  const checks = judge(describeEars(microphone), measured, motion, await freeBytes());
  showChecks(checks, summarise(checks), measured.subbands);
  showMicrophones(phone.choice);
}

/** The walker knows better. */
async function takeMicrophone() {
  const phone = /** @type {Phone} */ (page.phone);
  await chooseByHand(phone.microphone, /** @type {NonNullable<Phone["choice"]>} */ (phone.choice), at("microphone").value);
  await probe();
}

async function freeBytes() {
  const { quota, usage } = (await navigator.storage?.estimate?.()) ?? {};
  return quota === undefined ? null : quota - /** @type {number} */ (usage);
}

function askName() {
  at("walk-name").value ||= usualName(new Date());
  showView("name");
}

/** Once the probe has measured. */
async function walk() {
  const { microphone } = await openPhone();
  const startPose = parseStart(at("start-x").value, at("start-y").value, at("start-heading").value);
  const now = new Date();
  const { label, ...ears } = describeEars(microphone);
  /** @type {import("./manifest.js").Walk} */
  const state = {
    version: 1,
    name: at("walk-name").value.trim() || usualName(now),
    device: await describeDevice(navigator),
    startPose,
    startUtc: now.toISOString(),
    kind: /** @type {import("./framer.js").Kind} */ (
      /** @type {HTMLInputElement} */ (document.querySelector("input[name=kind]:checked")).value
    ),
    rateHz: microphone.context.sampleRate,
    chirp: page.chirp,
    capture: { microphone: label, ...ears, user_agent: navigator.userAgent },
    facts: { ...NO_FACTS, jumps: [], gaps: [] },
    recording: null,
    uploads: {},
    isOver: false,
  };
  const { makeSent } = await import("./finishing.js");
  const sent = makeSent(storage, walkKey(now, Math.random()), state, {});
  page.current = sent;
  at("record-title").textContent = state.name;
  showView("record");
  const recording = await walking();
  await recording.start(sent).catch((error) => {
    showView("name");
    throw error;
  });
}

/** @param {Sent} sent @param {Sending} [sending] */
async function finish(sent, sending) {
  const { showSending, startSending } = await import("./finishing.js");
  page.current = sent;
  page.sending = sending ?? startSending(sent, storage);
  await showSending(sent, storage, page.sending);
}

/** A place gets a name, and may be tapped when the walker comes by again. */
async function markPlace() {
  const field = /** @type {HTMLInputElement} */ (at("mark-name"));
  const name = field.value.trim(); // before anything is waited for: the next name may be written meanwhile
  (await walking()).mark(name);
  if (field.value.trim() !== name) return;
  field.value = "";
  field.blur();
}

async function stop() {
  showProblem(null);
  await (await walking()).end();
}

/**
 * A call or a sleeping page interrupts the walk, which goes on by itself or by a tap.
 * @param {Phone} phone
 */
function watchForInterruptions(phone) {
  /** @param {string} why */
  const interrupt = (why) => {
    loaded.locating?.stopFor(why);
    return loaded.recording?.interrupt(why);
  };
  watchInterruptions(phone.microphone, {
    taken: async () => {
      if (page.phone === phone) page.phone = null;
      await interrupt(t("The microphone was taken away, as by a call."));
      await phone.microphone.close();
    },
    silent: (isSilent) => loaded.recording?.silent(isSilent),
    stopped: () => interrupt(t("The sound was interrupted.")),
    running: () => loaded.recording?.goOnIfPossible(),
  });
}

/** A full phone ends the walk; what was recorded until then is kept and sent. */
function watchForRoom() {
  storage.onProblem(({ isFull, said }) => {
    if (!loaded.recording?.isOn()) return;
    showProblem(`${isFull ? t("This phone has no room left.") : said} ${t("The walk until then is kept.")}`);
    loaded.recording.end();
  });
}

/** Goes on with a walk that a reload or an empty battery broke off. @param {Sent} sent */
async function goOnWith(sent) {
  await act(async () => {
    await openPhone(); // before anything else is waited for: it needs the tap
    await page.begun;
    await (await import("./finishing.js")).mendFiles(sent, storage);
    page.walks = page.walks.filter((other) => other !== sent);
    page.current = sent;
    at("record-title").textContent = sent.state.name;
    showView("record");
    await (await walking()).start(sent).catch((error) => {
      page.walks = [sent, ...page.walks];
      showView("start");
      listUnfinished();
      throw error;
    });
  })();
}

/** @param {Sent} sent */
async function continueSending(sent) {
  await act(async () => {
    await (await import("./finishing.js")).mend(sent, storage, page.software);
    page.walks = page.walks.filter((other) => other !== sent);
    listUnfinished();
    await finish(sent);
  })();
}

/** @param {Sent} sent */
async function discardWalk(sent) {
  if (!(await askDiscard())) return;
  await act(async () => {
    await storage.ask({ do: "remove", walk: sent.walk });
    if (sent.state.recording) {
      await ask("DELETE", `/api/recordings/${sent.state.recording}`).catch(() => {});
    }
    page.walks = page.walks.filter((other) => other !== sent);
    listUnfinished();
    if (page.current === sent) showView("start");
  })();
}

function walkAgain() {
  showProblem(null);
  if (page.phone?.measured) askName();
  else showView("start");
}

at("start").append(languageChoice());
/** @type {{recording?: ReturnType<typeof import("./recording_controller.js").makeRecordingController>, locating?: ReturnType<typeof import("./locating/locating.js").makeLocating>}} */
const loaded = {};

/** What records walks. */
async function walking() {
  const { makeRecordingController } = await import("./recording_controller.js");
  return (loaded.recording ??= makeRecordingController({
    storage, finish, act, devices: openPhone,
    software: () => page.software, mediumAccess: () => page.mediumAccess,
    latencyS: () => (Number.isFinite(page.phone?.measured?.latencyS) ? Number(page.phone?.measured?.latencyS) : null),
  }));
}

/** A simulated phone is carried by somebody else where it is looked for. @returns {Promise<Phone>} */
async function openAsking() {
  if (page.simulated && page.simulated.who !== "other") {
    forgetPhone({ ...page.simulated, who: "other" });
  }
  return openPhone();
}

/** What locates. */
async function placing() {
  const { makeLocating } = await import("./locating/locating.js");
  return (loaded.locating ??= makeLocating({
    devices: openAsking, act, problem: showProblem, paired: () => /** @type {Promise<void>} */ (page.begun),
  }));
}

async function listMaps() {
  await (await placing()).list();
}

storage.onKept(({ walk: key, sizes }) => {
  if (page.current?.walk === key) Object.assign(page.current.sizes, sizes);
});
at("pair").addEventListener("submit", act(pairByHand));
at("allow").addEventListener("click", act(allow));
at("simulate").addEventListener("click", act(simulate));
at("where").addEventListener("click", act(listMaps));
at("maps-back").addEventListener("click", () => showView("start"));
at("probe-again").addEventListener("click", act(probe));
at("microphone").addEventListener("change", act(takeMicrophone));
at("go-on").addEventListener("click", askName);
at("name").addEventListener("submit", act(walk));
at("resume").addEventListener("click", act(async () => (await walking()).goOn()));
at("stop").addEventListener("click", act(stop));
at("mark").addEventListener("submit", act(markPlace));
at("send-again").addEventListener("click", act(() => finish(/** @type {Sent} */ (page.current))));
at("discard").addEventListener("click", () => discardWalk(/** @type {Sent} */ (page.current)));
at("another").addEventListener("click", walkAgain);
window.addEventListener("beforeunload", (event) => {
  if (loaded.recording?.isOn()) event.preventDefault();
});
watchForRoom();
page.begun = begin();
page.begun.then(async () => {
  await Promise.all([walking(), placing()]).catch(() => {}); // who needs them hears why they do not come
  if (page.isGuest) await act(listMaps)();
});

/** The microphone as it is, without the browser's improvements, and the sound clock that it runs on. */

import { Problem } from "../shared/api.js";
import { t } from "../shared/words.js";
import { ACCEPTED_RATES_HZ } from "../stages/constants.js";

/** Plain false: `exact` makes some browsers refuse altogether. */
const UNTOUCHED = {
  echoCancellation: false,
  noiseSuppression: false,
  autoGainControl: false,
  channelCount: 1,
};

/** What a track tells of itself, and the microphone of its track. */
const TOLD = ["ended", "mute", "unmute"];

/** @type {Record<string, string>} by the name of the error */
const REFUSALS = {
  NotAllowedError: t("The microphone is not allowed. Allow it for this page in the browser's settings, and try again."),
  NotFoundError: t("No microphone was found."),
  NotReadableError: t("Another app holds the microphone. Close it, and try again."),
  OverconstrainedError: t("No microphone was found."),
  InvalidStateError: t("The sound is taken, as by a call. End it, and try again."),
};

/**
 * @typedef {{context: AudioContext, readonly track: MediaStreamTrack, told: EventTarget,
 *   listenTo: (deviceId: string) => Promise<void>,
 *   pour: (to: string, sink: MessagePort | null) => void, close: () => Promise<void>}} Microphone told: that the
 *   track ended, was muted or unmuted; listenTo: another one in its place, raises Problem; pour: sends what is
 *   heard from now on to another port as well, by name; null ends that
 */

/** @param {number} rate */
function wrongRate(rate) {
  return t("The sound of this phone runs at {{rate}} samples/s; wanted 44100 or 48000. Take off Bluetooth and wired headsets, close other apps that use sound, and open the page again.", { rate });
}

/** @param {unknown} thrown */
function refusal(thrown) {
  const { name, message } = /** @type {Error} */ (thrown);
  return new Problem(REFUSALS[name] ?? message, 0);
}

/** @param {ConstrainDOMString | undefined} deviceId @returns {Promise<MediaStream>} */
function askFor(deviceId) {
  return navigator.mediaDevices.getUserMedia({ audio: deviceId ? { ...UNTOUCHED, deviceId } : UNTOUCHED });
}

/**
 * Must be called from a tap. Raises Problem.
 * @param {string} [deviceId] the one to listen to, where it is still there
 * @returns {Promise<Microphone>}
 */
export async function openMicrophone(deviceId) {
  if (!navigator.mediaDevices?.getUserMedia || !window.AudioWorkletNode) {
    throw new Problem(t("This browser gives pages no microphone here. Open the page by its https address."), 0);
  }
  const context = new AudioContext({ latencyHint: "playback" });
  const resumed = context.resume();
  let stream;
  try {
    stream = await askFor(deviceId);
    await resumed;
    if (!ACCEPTED_RATES_HZ.includes(context.sampleRate)) throw new RangeError(wrongRate(context.sampleRate));
    return await connect(context, stream);
  } catch (thrown) {
    stream?.getTracks().forEach((track) => track.stop());
    await context.close();
    throw refusal(thrown);
  }
}

/** @param {AudioContext} context @param {MediaStream} stream @returns {Promise<Microphone>} */
async function connect(context, stream) {
  await context.audioWorklet.addModule(new URL("./capture.worklet.js", import.meta.url));
  const capture = new AudioWorkletNode(context, "capture", {
    numberOfInputs: 1,
    numberOfOutputs: 1,
    channelCount: 1,
    channelCountMode: "explicit",
    channelInterpretation: "discrete",
  });
  capture.connect(new GainNode(context, { gain: 0 })).connect(context.destination);
  const told = new EventTarget();
  let heard = hear(context, stream, capture, told);
  /** @type {Microphone["listenTo"]} */
  const listenTo = async (deviceId) => {
    heard.leave(); // phones give one at a time
    heard = hear(context, await askFor({ exact: deviceId }).catch((thrown) => {
      throw refusal(thrown);
    }), capture, told);
  };
  const close = async () => {
    heard.leave();
    capture.disconnect();
    await context.close();
  };
  /** @type {Microphone["pour"]} */
  const pour = (to, sink) => capture.port.postMessage({ to, sink }, sink ? [sink] : []);
  return { context, get track() { return heard.track; }, told, listenTo, pour, close };
}

/** @param {AudioContext} context @param {MediaStream} stream @param {AudioNode} capture @param {EventTarget} told */
function hear(context, stream, capture, told) {
  const source = new MediaStreamAudioSourceNode(context, { mediaStream: stream });
  source.connect(capture);
  const [track] = stream.getAudioTracks();
  const tell = (/** @type {Event} */ { type }) => told.dispatchEvent(new Event(type));
  TOLD.forEach((what) => track.addEventListener(what, tell));
  const leave = () => {
    TOLD.forEach((what) => track.removeEventListener(what, tell));
    track.stop();
    source.disconnect();
  };
  return { track, leave };
}

/**
 * Lets suspended sound go on, and says whether it does. Interrupted sound is not asked to: WebKit would say that it
 * runs while its clock stands.
 * @param {AudioContext} context
 */
export async function resume(context) {
  if (context.state === "suspended") await context.resume();
  return context.state === "running";
}

/** @param {Microphone} microphone @returns {import("./verdicts.js").Ears} */
export function describeEars({ context, track }) {
  return {
    label: track.label,
    contextRateHz: context.sampleRate,
    settings: track.getSettings(),
    outputLatencyS: context.outputLatency ?? 0,
  };
}

// Which of several microphones listens: each is tried with chirps, and the one that hears most of their echoes is kept
// for this phone. One that hears no chirps, as a headset's, is never chosen but by hand.

const KEPT = "elfslam-microphone";
/** Another one must hear so much more than the one that the browser gave. */
const AHEAD_DB = 3;

/**
 * @typedef {{deviceId: string, label: string, echoDb: number | null}} Tried echoDb: null where it heard no chirps
 * @typedef {{chosen: string, isByHand: boolean, tried: Tried[]}} Choice
 */

/** What was chosen on this phone before. @returns {Choice | null} */
export function keptChoice() {
  try {
    return JSON.parse(localStorage.getItem(KEPT) ?? "null");
  } catch {
    return null;
  }
}

/** @param {Choice} choice */
function keep(choice) {
  try {
    localStorage.setItem(KEPT, JSON.stringify(choice));
  } catch {
    // a browser that keeps nothing tries them again
  }
  return choice;
}

/**
 * The choice between those that are there, null where there is one alone; the microphone listens to it then.
 * @param {Microphone} microphone
 * @param {() => Promise<import("./probe.js").Measured>} hear measures chirps
 * @param {() => void} trying is told before each is tried, which takes a second
 */
export async function chooseMicrophone(microphone, hear, trying) {
  const there = await microphonesThere();
  if (there.length < 2) return null;
  const given = microphone.track.getSettings().deviceId;
  const kept = keptChoice();
  if (kept && isStillGood(kept, there)) {
    if (given !== kept.chosen) await microphone.listenTo(kept.chosen);
    return kept;
  }
  trying();
  /** @type {Tried[]} */
  const tried = [];
  for (const { deviceId, label } of there) {
    tried.push({ deviceId, label, echoDb: await echoDbOf(microphone, deviceId, hear) });
  }
  const { deviceId: chosen } = bestOf(tried, given);
  await microphone.listenTo(chosen);
  return keep({ chosen, isByHand: false, tried });
}

/** @param {Microphone} microphone @param {Choice} choice @param {string} chosen by hand */
export async function chooseByHand(microphone, choice, chosen) {
  await microphone.listenTo(chosen);
  return keep({ ...choice, chosen, isByHand: true });
}

/** The one that hears most, but the given one where no other is well ahead. @param {Tried[]} tried @param {string} [given] */
export function bestOf(tried, given) {
  /** @param {Tried} one */
  const level = ({ echoDb }) => echoDb ?? -Infinity;
  const usual = tried.find(({ deviceId }) => deviceId === given) ?? tried[0];
  const loudest = tried.reduce((best, one) => (level(one) > level(best) ? one : best));
  return level(loudest) > level(usual) + AHEAD_DB ? loudest : usual;
}

/** One that is listed as the default and by its own name, too, counts once. @returns {Promise<MediaDeviceInfo[]>} */
async function microphonesThere() {
  const listed = (await navigator.mediaDevices.enumerateDevices()).filter(({ kind }) => kind === "audioinput");
  /** @param {MediaDeviceInfo} one */
  const isAnother = ({ deviceId, groupId }) =>
    deviceId === "default" && listed.some((other) => other.deviceId !== deviceId && other.groupId === groupId);
  return listed.filter((one) => one.deviceId !== "communications" && !isAnother(one));
}

/** @param {Choice} choice @param {MediaDeviceInfo[]} there */
function isStillGood({ chosen, isByHand, tried }, there) {
  const ids = there.map(({ deviceId }) => deviceId);
  const isSame = ids.length === tried.length && tried.every(({ deviceId }) => ids.includes(deviceId));
  return ids.includes(chosen) && (isSame || isByHand);
}

/** @param {Microphone} microphone @param {string} deviceId @param {() => Promise<import("./probe.js").Measured>} hear */
async function echoDbOf(microphone, deviceId, hear) {
  try {
    await microphone.listenTo(deviceId);
  } catch {
    return null; // it is held elsewhere, or gone
  }
  return (await hear()).echoDb ?? (await hear()).echoDb; // what has just been opened may begin late
}

// What takes sound away from a page: a call, another app, a screen that goes dark.

/**
 * @param {Microphone} microphone
 * @param {{taken: () => void, silent: (isSilent: boolean) => void, stopped: () => void, running: () => void}} told
 *   taken: the microphone is gone for good; silent: it hears nothing for the time being; stopped and running:
 *   the whole of the sound
 */
export function watchInterruptions({ context, told: track }, told) {
  track.addEventListener("ended", told.taken);
  track.addEventListener("mute", () => told.silent(true));
  track.addEventListener("unmute", () => told.silent(false));
  context.addEventListener("statechange", () => {
    if (context.state === "running") told.running();
    else if (context.state !== "closed") told.stopped();
  });
  // Browsers that stopped the sound while the page was hidden may let it go on once it is seen.
  const seen = () => {
    if (context.state === "closed") document.removeEventListener("visibilitychange", seen);
    else if (!document.hidden) resume(context).catch(() => {});
  };
  document.addEventListener("visibilitychange", seen);
}

/** The microphone as it is, without the browser's improvements, and the sound clock that it runs on. */

import { Problem } from "../shared/api.js";
import { ACCEPTED_RATES_HZ } from "./chirp.js";
import { t } from "../shared/words.js";

/** Plain false: `exact` makes some browsers refuse altogether. */
const UNTOUCHED = {
  echoCancellation: false,
  noiseSuppression: false,
  autoGainControl: false,
  channelCount: 1,
};

/** @type {Record<string, string>} by the name of the error */
const REFUSALS = {
  NotAllowedError: t("The microphone is not allowed. Allow it for this page in the browser's settings, and try again."),
  NotFoundError: t("No microphone was found."),
  NotReadableError: t("Another app holds the microphone. Close it, and try again."),
};

/**
 * @typedef {{context: AudioContext, track: MediaStreamTrack,
 *   pour: (to: string, sink: MessagePort | null) => void, close: () => Promise<void>}} Microphone pour:
 *   sends what is heard from now on to another port as well, by name; null ends that
 */

/** @param {number} rate */
function wrongRate(rate) {
  return t("The sound of this phone runs at {{rate}} samples/s; wanted 44100 or 48000. Take off Bluetooth and wired headsets, close other apps that use sound, and open the page again.", { rate });
}

/** Must be called from a tap. Raises Problem. @returns {Promise<Microphone>} */
export async function openMicrophone() {
  if (!navigator.mediaDevices?.getUserMedia || !window.AudioWorkletNode) {
    throw new Problem(t("This browser gives pages no microphone here. Open the page by its https address."), 0);
  }
  if (navigator.audioSession) navigator.audioSession.type = "play-and-record";
  const context = new AudioContext({ latencyHint: "playback" });
  const resumed = context.resume();
  let stream;
  try {
    stream = await navigator.mediaDevices.getUserMedia({ audio: UNTOUCHED });
    await resumed;
    if (!ACCEPTED_RATES_HZ.includes(context.sampleRate)) throw new RangeError(wrongRate(context.sampleRate));
    return await connect(context, stream);
  } catch (thrown) {
    const error = /** @type {Error} */ (thrown);
    stream?.getTracks().forEach((track) => track.stop());
    await context.close();
    throw new Problem(REFUSALS[error.name] ?? error.message, 0);
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
  const source = new MediaStreamAudioSourceNode(context, { mediaStream: stream });
  source.connect(capture);
  capture.connect(new GainNode(context, { gain: 0 })).connect(context.destination);
  const [track] = stream.getAudioTracks();
  const close = async () => {
    track.stop();
    capture.disconnect();
    source.disconnect();
    await context.close();
  };
  /** @type {Microphone["pour"]} */
  const pour = (to, sink) => capture.port.postMessage({ to, sink }, sink ? [sink] : []);
  return { context, track, pour, close };
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

/** What takes sound away from a page: a call, another app, a screen that goes dark. */

import { resume } from "./microphone.js";

/**
 * @param {import("./microphone.js").Microphone} microphone
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

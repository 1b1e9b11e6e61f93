/** Keeps the screen on: browsers let go of the lock whenever the page is hidden, and refuse it to save the battery. */

/**
 * @param {HTMLElement} refusal says that the screen may go dark; shown while it may
 * @returns {{stop: () => void}}
 */
export function stayAwake(refusal) {
  /** @type {WakeLockSentinel | null} */
  let lock = null;
  let isWanted = true;
  const request = async () => {
    if (!isWanted || document.visibilityState !== "visible") return;
    lock = (await navigator.wakeLock?.request("screen").catch(() => null)) ?? null;
    lock?.addEventListener("release", request);
    if (isWanted) refusal.hidden = lock !== null;
    else lock?.release();
  };
  document.addEventListener("visibilitychange", request);
  request();
  return {
    stop: () => {
      isWanted = false;
      document.removeEventListener("visibilitychange", request);
      refusal.hidden = true;
      lock?.release();
    },
  };
}

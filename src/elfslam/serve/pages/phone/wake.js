/** Keeps the screen on: browsers let go of the lock whenever the page is hidden. */

/** @returns {{stop: () => void}} */
export function stayAwake() {
  /** @type {WakeLockSentinel | null} */
  let lock = null;
  let isWanted = true;
  const request = async () => {
    if (!isWanted || document.visibilityState !== "visible") return;
    lock = (await navigator.wakeLock?.request("screen").catch(() => null)) ?? null;
  };
  document.addEventListener("visibilitychange", request);
  request();
  return {
    stop: () => {
      isWanted = false;
      document.removeEventListener("visibilitychange", request);
      lock?.release();
    },
  };
}

/** The page kept on the phone: it opens without its server, and a new version takes over when nothing goes on. */

import { t } from "../shared/words.js";

/**
 * @typedef {{isKept: boolean, why: string}} Offline whether the page opens without a network, else why not
 */

const KEPT = { isKept: true, why: "" };
const NO_WORKER = {
  isKept: false,
  why: t("This browser keeps no pages: open the page by https, in a window that is not private."),
};
const NOT_TRUSTED = {
  isKept: false,
  why: t("The page is not kept on this phone: install the server's authority, so that the browser trusts it."),
};
const NOT_WHOLE = {
  isKept: false,
  why: t("The page did not come whole, or this phone has no room for it. Open it again later."),
};
/**
 * Keep the page, and change to a new version of it while `isIdle` says that nothing goes on.
 * @param {() => boolean} isIdle @returns {Promise<Offline>} when it is kept, or cannot be
 */
export async function keepPage(isIdle) {
  const workers = navigator.serviceWorker;
  if (!workers) return NO_WORKER;
  const hadOlder = workers.controller !== null;
  workers.addEventListener("message", ({ data }) => {
    if (data === "changed" && isIdle()) window.location.reload();
  });
  try {
    const worker = new URL("../service_worker.js", import.meta.url);
    const registration = await workers.register(worker, { updateViaCache: "none" });
    watch(registration, isIdle);
    return await Promise.race([workers.ready.then(() => KEPT), failing(registration)]);
  } catch {
    return hadOlder ? KEPT : NOT_TRUSTED;
  }
}

/** Ends when the first version could not be kept. @param {ServiceWorkerRegistration} registration */
function failing({ installing }) {
  return new Promise((resolve) => {
    installing?.addEventListener("statechange", () => {
      if (installing.state === "redundant") resolve(NOT_WHOLE);
    });
  });
}

/**
 * A version that has just come takes over if nothing goes on, else when this page has been closed.
 * @param {ServiceWorkerRegistration} registration @param {() => boolean} isIdle
 */
function watch(registration, isIdle) {
  registration.addEventListener("updatefound", () => {
    const { installing } = registration;
    installing?.addEventListener("statechange", () => {
      if (installing.state === "installed" && registration.active && isIdle()) installing.postMessage("begin");
    });
  });
}

// Keeps the phone page as soon as it is there; `data-offline` of the page says how that went.

const isIdle = () => document.getElementById("start")?.hidden === false;

const { isKept, why } = await keepPage(isIdle);
document.documentElement.dataset.offline = isKept ? "kept" : why;

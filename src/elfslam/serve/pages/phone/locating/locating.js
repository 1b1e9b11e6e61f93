/** The view "Where am I", from the list of maps to the walker on one of them. */

import { ask } from "../../shared/api.js";
import { loadPlanImage } from "../../shared/map/plan_image.js";
import { at, showView } from "../view.js";
import { stayAwake } from "../wake.js";
import { mountPlaceMap } from "./place_map.js";
import { rowsOf } from "./maps.js";
import { startPlacing } from "./place.js";
import {
  askRemove, showMap, showMaps, showMapsTrouble, showPlaceFacts, showProgress, showRunning, showWords, speak, speakPlace,
} from "./place_view.js";
import { NO_TRAIL, withFix } from "./trail.js";
import { STOPPED, WAITING, wordsOf } from "./words.js";

/** A status that lasts so long is worth saying aloud. */
const SPEAK_AFTER_MS = 1500;
const CLOCK_MS = 500;
const NO_SERVER = "The server does not answer. The maps on this phone work without it.";

/**
 * @param {{
 *   packages: import("../../keeping/packages.js").Packages,
 *   devices: () => Promise<import("../devices.js").Devices>,
 *   act: (work: () => Promise<void>) => () => Promise<void>,
 *   problem: (said: string | null) => void,
 * }} given devices: opened by the tap that starts locating
 */
export function makeLocating({ packages, devices, act, problem }) {
  const view = { row: null, kept: null, map: null, running: null };

  async function list() {
    showView("maps");
    const kept = await packages.list();
    showMaps(rowsOf(kept, null), does);
    const offered = await ask("GET", "/api/maps").catch((error) => {
      showMapsTrouble(kept.length > 0 && error.status === 0 ? NO_SERVER : error.message);
      return null;
    });
    if (offered) showMapsTrouble(null);
    showMaps(rowsOf(kept, offered), does);
  }

  const does = {
    open: (row) => act(() => open(row))(),
    get: (row) => act(() => get(row))(),
    remove: (row) => act(() => remove(row))(),
  };

  async function get({ id }) {
    try {
      await packages.update(id, (progress) => showProgress(id, progress));
    } finally {
      showProgress(id, null);
    }
    await list();
  }

  async function remove({ id }) {
    if (!(await askRemove())) return;
    await packages.remove(id);
    await list();
  }

  async function open(row) {
    const opened = devices();
    view.row = row;
    view.kept = await packages.open(row.id);
    await opened;
    view.map?.leave();
    view.map = mountPlaceMap(view.kept.floorMap, row.name, { say: () => speakPlace(view.trail.fix, mode()) });
    showMap(row.name, view.map.stage);
    showView("place");
    await showPlan(view.kept.facts.floorPlan);
    await start();
  }

  async function showPlan(plan) {
    if (!plan?.placement) return;
    const address = URL.createObjectURL(plan.image);
    const picture = await loadPlanImage(address).catch(() => null);
    URL.revokeObjectURL(address);
    if (picture) view.map.setPlan({ ...picture, placement: plan.placement });
  }

  async function start() {
    problem(null);
    reset();
    const opened = await devices();
    if (opened.microphone.context.state !== "running") await opened.microphone.context.resume();
    const awake = stayAwake();
    const begun = performance.now();
    const shown = showing(view, mode());
    const placing = await startPlacing(opened, view.kept, mode(), { ...shown.told, problem: stopFor });
    const timer = setInterval(() => shown.clock((performance.now() - begun) / 1000), CLOCK_MS);
    view.running = () => {
      clearInterval(timer);
      placing.stop();
      awake.stop();
    };
    showRunning(true);
  }

  function reset() {
    stop();
    view.trail = NO_TRAIL;
    view.map.setTrail(NO_TRAIL);
    showWords(WAITING[mode()]);
    speak(WAITING[mode()]);
  }

  function stop() {
    view.running?.();
    view.running = null;
    showRunning(false);
  }

  /** What ends locating from outside: a call, another app. @param {string} why */
  function stopFor(why) {
    if (!view.running) return;
    stop();
    problem(why);
  }

  const leave = () => {
    stop();
    return list();
  };
  at("place-stop").addEventListener("click", () => {
    stop();
    showWords(STOPPED);
    speak(STOPPED);
    at("place-start").focus();
  });
  at("place-start").addEventListener("click", () => act(start)());
  at("place-back").addEventListener("click", () => act(leave)());
  at("place-mode").addEventListener("change", () => view.running && act(start)());
  return { list, stopFor };
}

/** @returns {"track" | "one-shot"} */
function mode() {
  return document.querySelector("input[name=place-mode]:checked").value;
}

/** Fixes and echoes as the view tells them. */
function showing(view, how) {
  const counts = { fixes: 0, heard: 0, firstS: null, lastS: null };
  let spoken = WAITING[how].title;
  let saying = 0;
  const fix = (found) => {
    view.trail = withFix(view.trail, found);
    view.map.setTrail(view.trail);
    counts.fixes = view.trail.count;
    const words = wordsOf(found);
    showWords(words);
    clearTimeout(saying);
    if (words.verdict !== spoken) {
      saying = setTimeout(() => {
        spoken = words.verdict;
        speak(words);
      }, SPEAK_AFTER_MS);
    }
  };
  const echo = ({ tS }) => {
    counts.heard += 1;
    counts.firstS ??= tS;
    counts.lastS = tS;
  };
  const clock = (seconds) => showPlaceFacts({ seconds, fixes: counts.fixes, heardShare: heardShare(counts, view.kept) });
  return { told: { fix, echo }, clock };
}

/** Of the chirps since the first that was heard. */
function heardShare({ heard, firstS, lastS }, { floorMap }) {
  if (firstS === null) return null;
  return Math.min(heard / Math.round(1 + (lastS - firstS) / floorMap.parameters.chirp.period_s), 1);
}

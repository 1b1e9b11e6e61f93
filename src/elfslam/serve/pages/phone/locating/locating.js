/** The view "Where am I": a walker on a map, from the tap that starts it to the one that stops it. */

import { loadPlanImage } from "../../shared/map/ground.js";
import { at, showView } from "../view.js";
import { stayAwake } from "../wake.js";
import { makeChoosing } from "./choosing.js";
import { makeConsent, offerDeletion } from "./consent.js";
import { tableOfFixes } from "./fixes_table.js";
import { startPlacing } from "./place.js";
import { mountPlaceMap } from "./place_map.js";
import { offerFixes, showMap, showRunning, showWords, speak, speakPlace } from "./place_view.js";
import { showFixes } from "./showing.js";
import { NO_TRAIL } from "./trail.js";
import { offerWays } from "./way.js";
import { READYING, STOPPED, WAITING } from "./words.js";

/**
 * What the view knows.
 * @typedef {object} Here
 * @property {import("../../keeping/packages.js").Opened | null} kept the map
 * @property {ReturnType<typeof mountPlaceMap> | null} map
 * @property {ReturnType<typeof offerWays> | null} ways to its named places
 * @property {import("./trail.js").Trail} trail
 * @property {(() => void) | null} running stops it
 */

/**
 * @param {{
 *   devices: () => Promise<import("../devices.js").Devices>,
 *   act: (work: () => Promise<void>) => (event?: Event) => Promise<void>,
 *   problem: (said: string | null) => void,
 *   paired: () => Promise<void>,
 * }} given devices: opened by the tap that starts locating
 */
export function makeLocating({ devices, act, problem, paired }) {
  /** @type {Here} */
  const here = { kept: null, map: null, ways: null, trail: NO_TRAIL, running: null };
  const consent = makeConsent({ problem });
  offerDeletion({ act });
  const choosing = makeChoosing({ act, chosen: open, paired });

  /** @param {import("./maps.js").MapRow} row @param {import("../../keeping/packages.js").Packages} packages */
  async function open(row, packages) {
    const opening = devices(); // before anything is waited for: it needs the tap
    opening.catch(() => {});
    here.kept = await packages.open(row.id);
    here.map?.leave();
    here.map = mountPlaceMap(here.kept.floorMap, row.name, { say: () => speakPlace(here.trail.fix, mode(), here.ways?.words() ?? "") });
    const { floorMap, facts } = here.kept;
    here.ways = offerWays(floorMap, facts.pointsOfInterest, here.map.setWay);
    here.map.setPoints(facts.pointsOfInterest);
    showMap(row.name, here.map.stage);
    showRunning(false);
    showView("place");
    await showPlan(here.map, facts.floorPlan);
    await opening;
    await start();
  }

  /** Once a map is open. */
  async function start() {
    if (!here.kept || !here.map) return;
    stop();
    here.trail = NO_TRAIL;
    here.map.setTrail(NO_TRAIL);
    here.ways?.fix(null);
    tell(READYING);
    at("place-start").disabled = true;
    const opened = await devices();
    const awake = stayAwake(at("awake"));
    const by = mode();
    const shown = showFixes(here, by);
    const told = { ...shown.told, fix: tellAll(shown.told.fix, consent.fix, (found) => here.ways?.fix(found)), problem: stopFor };
    const placing = await startPlacing(opened, here.kept, by, told).catch((error) => {
      awake.stop();
      at("place-start").disabled = false;
      tell(STOPPED);
      throw error;
    });
    tell(WAITING[by]);
    shown.begin(placing.playedUntil);
    consent.offer(here.kept.facts.map, here.kept.facts.name, placing.nowS);
    here.running = () => {
      consent.withdraw();
      shown.end();
      placing.stop();
      awake.stop();
      offerFixes(tableOfFixes(shown.fixes(), placing.zeroS()));
    };
    at("place-start").disabled = false;
    showRunning(true);
    if (mode() !== by) await start(); // it was chosen while the devices opened
  }

  function stop() {
    here.running?.();
    here.running = null;
    showRunning(false);
  }

  /** What ends locating from outside: a call, another app. @param {string} why */
  function stopFor(why) {
    if (!here.running) return;
    stop();
    tell(STOPPED);
    problem(why);
  }

  function stopByHand() {
    stop();
    tell(STOPPED);
    at("place-start").focus();
  }

  const leave = () => {
    stop();
    return choosing.list();
  };
  at("place-stop").addEventListener("click", stopByHand);
  at("place-start").addEventListener("click", act(start));
  at("place-back").addEventListener("click", act(leave));
  at("place-mode").addEventListener("change", () => here.running && act(start)());
  return { list: choosing.list, stopFor };
}

/** @template T @param {...(value: T) => void} others @returns {(value: T) => void} */
function tellAll(...others) {
  return (value) => others.forEach((each) => each(value));
}

/** @param {import("./words.js").Words} words */
function tell(words) {
  showWords(words);
  speak(words);
}

/**
 * @param {ReturnType<typeof mountPlaceMap>} map
 * @param {import("../../keeping/packages.js").Facts["floorPlan"]} plan
 */
async function showPlan(map, plan) {
  if (!plan?.placement) return;
  const address = URL.createObjectURL(new Blob([plan.bytes], { type: plan.type }));
  const picture = await loadPlanImage(address).catch(() => null);
  URL.revokeObjectURL(address);
  if (picture) map.setPlan({ ...picture, placement: plan.placement });
}

/** @returns {"track" | "one-shot"} */
function mode() {
  const chosen = /** @type {HTMLInputElement} */ (document.querySelector("input[name=place-mode]:checked"));
  return /** @type {"track" | "one-shot"} */ (chosen.value);
}

/** The view "Where am I": a walker on a map, from the tap that starts it to the one that stops it. */

import { loadPlanImage } from "../../shared/map/ground.js";
import { KIND_WORDS } from "../../shared/map/points_of_interest.js";
import { byName } from "../../shared/places.js";
import { inSentence, t } from "../../shared/words.js";
import { wayFrom, wayGraphOf, waysTo, withoutSteps } from "../../stages/ways.js";
import { stayAwake } from "../devices.js";
import { at, make, showView } from "../view.js";
import { makeChoosing } from "./choosing.js";
import { startPlacing } from "./place.js";
import { NO_TRAIL, mountPlaceMap, withFix } from "./place_map.js";
import { offerFixes, showFloors, showMap, showPlaceFacts, showRunning, showWords, speak, speakPlace } from "./place_view.js";
import { makeConsent, offerDeletion } from "./position_publisher.js";
import { floorWayWords, pointsOf, wayWords } from "./walked_ground.js";
import { FLOOR_UNKNOWN, READYING, STOPPED, WAITING, floorName, theFloor, wordsOf } from "./words.js";

/** So many spots of other floors vote at once: eight floors of ten minutes' walk, 33 MB. */
const MOST_SPOTS = 60_000;

/**
 * What the view knows.
 * @typedef {object} Here
 * @property {import("../../keeping/packages.js").Packages | null} packages
 * @property {import("../../keeping/packages.js").Opened | null} kept the map
 * @property {WalkedFloor[]} others floors of its building on this phone
 * @property {number} level the floor that is shown, or will be as soon as its map is open
 * @property {ReturnType<typeof mountPlaceMap> | null} map
 * @property {ReturnType<typeof offerWays> | null} ways to its named places
 * @property {import("./place_map.js").Trail} trail
 * @property {Awaited<ReturnType<typeof startPlacing>> | null} placing
 * @property {(() => void) | null} running stops it
 */

/**
 * @param {{
 *   devices: () => Promise<import("../devices.js").Devices>,
 *   act: (work: () => Promise<void>) => (event?: Event) => Promise<void>,
 *   problem: (said: string | null, verdict?: "fail" | "wait") => void,
 *   paired: () => Promise<void>,
 * }} given devices: opened by the tap that starts locating
 */
export function makeLocating({ devices, act, problem, paired }) {
  /** @type {Here} */
  const here = { packages: null, kept: null, others: [], level: 0, map: null, ways: null, trail: NO_TRAIL, placing: null, running: null };
  const consent = makeConsent({ problem });
  offerDeletion({ act });
  const choosing = makeChoosing({ act, chosen: open, paired });

  /** @param {{id: string}} row @param {import("../../keeping/packages.js").Packages} packages */
  async function open(row, packages) {
    stop();
    const opening = devices(); // before anything is waited for: it needs the tap
    opening.catch(() => {});
    here.packages = packages;
    here.ways = null;
    await show(await packages.open(row.id));
    showRunning(false);
    showView("place");
    await opening;
    await start();
  }

  /** Whoever wants to go somewhere still does. @param {import("../../keeping/packages.js").Opened} kept */
  async function show(kept) {
    const { floorMap, facts } = kept;
    here.kept = kept;
    here.level = facts.level;
    here.trail = NO_TRAIL;
    here.map?.leave();
    here.map = mountPlaceMap(floorMap, facts.name, { say: () => speakPlace(here.trail.fix, mode(), here.ways?.words() ?? "") });
    const grounds = await Promise.all(facts.floors.map(({ map }) => here.packages?.ground(map)));
    here.others = grounds.filter((each) => each !== null && each !== undefined);
    here.ways = offerWays([{ ...facts, xyM: floorMap.xyM }, ...here.others], here.ways?.goal() ?? null, here.map.setWay, sayFloor);
    showFloors([facts, ...here.others].map(({ level }) => level).sort((a, b) => a - b), facts.level, sayFloor);
    here.map.setPoints(facts.pointsOfInterest);
    showMap(facts.name, here.map.stage);
    await showPlan(here.map, facts.floorPlan);
  }

  /** The map of another floor of the building. @param {number} level */
  async function turnTo(level) {
    consent.withdraw(); // others were to see the walker on the floor shown
    here.level = level;
    const { map } = here.others.find((each) => each.level === level) ?? {};
    const kept = map && await here.packages?.open(map);
    if (!kept || here.level !== level) return; // another one was wanted meanwhile
    await show(kept);
    if (here.placing) offerConsent(here.placing);
  }

  /** The walker says on which floor they are. @param {number} level */
  const sayFloor = (level) => act(async () => {
    const before = here.kept?.floorMap;
    if (here.kept?.facts.level !== level) await turnTo(level);
    if (!here.placing || !here.kept || here.level !== level) return;
    if (here.kept.floorMap.encoder !== before?.encoder) await start(); // they were mapped apart
    here.placing.say({ level, floorMap: here.kept.floorMap });
  })();

  /** @param {NonNullable<Here["placing"]>} placing */
  function offerConsent({ nowS }) {
    if (here.kept) consent.offer(here.kept.facts.map, here.kept.facts.name, nowS);
  }

  /** The other floors kept, the nearest first, as far as there is room for them. @param {NonNullable<Here["placing"]>} placing */
  async function joinFloors(placing) {
    const floors = [];
    let spots = 0;
    for (const { level, map, xyM } of [...here.others].sort((a, b) => Math.abs(a.level - here.level) - Math.abs(b.level - here.level))) {
      if ((spots += xyM.length / 2) > MOST_SPOTS) break;
      const kept = await here.packages?.open(map).catch(() => null); // what is damaged has no vote
      if (kept) floors.push({ level, floorMap: kept.floorMap });
    }
    placing.join(floors);
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
    const shown = showFixes(here, by, (level) => act(() => turnTo(level))());
    const told = { ...shown.told, fix: tellAll(shown.told.fix, consent.fix, (found) => here.ways?.fix(found)), problem: stopFor };
    const level = here.others.length > 0 ? here.kept.facts.level : undefined;
    const placing = await startPlacing(opened, here.kept, level, by, told).catch((error) => {
      awake.stop();
      at("place-start").disabled = false;
      tell(STOPPED);
      throw error;
    });
    tell(WAITING[by]);
    shown.begin(placing.playedUntil);
    here.placing = placing;
    offerConsent(placing);
    here.running = () => {
      here.placing = null;
      consent.withdraw();
      shown.end();
      placing.stop();
      awake.stop();
      offerFixes(tableOfFixes(shown.fixes(), placing.zeroS()));
    };
    at("place-start").disabled = false;
    showRunning(true);
    if (mode() !== by) await start(); // it was chosen while the devices opened
    else if (level !== undefined) await joinFloors(placing);
  }

  function stop() {
    here.running?.();
    here.running = null;
    showRunning(false);
  }

  /** What ends locating from outside: a call, another app. @param {string} why @param {"fail" | "wait"} [verdict] */
  function stopFor(why, verdict = "fail") {
    if (!here.running) return;
    stop();
    tell(STOPPED);
    problem(why, verdict);
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
  at("place-stairs").addEventListener("click", () => {
    here.placing?.say(null);
    tell(FLOOR_UNKNOWN);
  });
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

// Fixes and echoes as they come, told by the view.

/** A status that lasts so long is worth saying aloud. */
const SPEAK_AFTER_MS = 1500;
const CLOCK_MS = 500;

/**
 * @typedef {import("./words.js").Fix} Fix
 * @typedef {(heardS: number) => number} PlayedUntil how many chirps should have been heard
 */

/**
 * @param {Here} here @param {"track" | "one-shot"} mode @param {(level: number) => void} turnTo the floor of the walker is another
 * @returns {{told: {fix: (fix: Fix) => void, echo: (echo: {tS: number}) => void},
 *   begin: (playedUntil: PlayedUntil) => void, end: () => void, fixes: () => Fix[]}}
 */
function showFixes(here, mode, turnTo) {
  /** @type {Fix[]} */
  const fixes = [];
  const echoes = { count: 0, lastS: NaN };
  const speaker = makeSpeaker(WAITING[mode]);
  let timer = 0;

  /** @param {Fix} found */
  const fix = (found) => {
    fixes.push(found);
    if (typeof found.level === "number" && found.level !== here.level) turnTo(found.level);
    if (here.level !== here.kept?.facts.level) return; // its map comes
    here.trail = withFix(here.trail, found);
    here.map?.setTrail(here.trail);
    showWords(wordsOf(found));
    speaker.consider(wordsOf(found));
  };
  /** @param {{tS: number}} echo */
  const echo = ({ tS }) => {
    echoes.lastS = tS;
    echoes.count += 1;
  };
  /** @param {PlayedUntil} playedUntil */
  const begin = (playedUntil) => {
    const beganMs = performance.now();
    const show = () => showPlaceFacts({
      seconds: (performance.now() - beganMs) / 1000,
      fixes: here.trail.count,
      heardShare: heardShare(echoes, playedUntil),
    });
    show();
    timer = setInterval(show, CLOCK_MS);
  };
  const end = () => {
    clearInterval(timer);
    speaker.hush();
  };
  return { told: { fix, echo }, begin, end, fixes: () => fixes };
}

/**
 * Of the chirps that were played until the last that was heard.
 * @param {{count: number, lastS: number}} echoes @param {PlayedUntil} playedUntil
 */
function heardShare({ count, lastS }, playedUntil) {
  return count === 0 ? null : Math.min(count / Math.max(playedUntil(lastS), 1), 1);
}

/** Says aloud what has become different and stays so. @param {import("./words.js").Words} first */
function makeSpeaker(first) {
  let said = first.verdict;
  let timer = 0;
  /** @param {import("./words.js").Words} words */
  const consider = (words) => {
    clearTimeout(timer);
    if (words.verdict === said) return;
    timer = setTimeout(() => {
      said = words.verdict;
      speak(words);
    }, SPEAK_AFTER_MS);
  };
  return { consider, hush: () => clearTimeout(timer) };
}

// Fixes as a table, the same that `elfslam locate` writes. Pure.

const HEADER = "t_s,x_m,y_m,heading_rad,sigma_m,status";

/** @param {import("./words.js").Fix[]} fixes @param {number} zeroS of their clock, which is 0 in the table */
function tableOfFixes(fixes, zeroS) {
  const header = fixes[0]?.level === undefined ? HEADER : `${HEADER},level`;
  return `${header}\n${fixes.map((fix) => rowOf(fix, zeroS)).join("")}`;
}

/** @param {import("./words.js").Fix} fix @param {number} zeroS */
function rowOf({ tS, xyM, headingRad, covarianceM2, status, level }, zeroS) {
  const sigma = covarianceM2 ? Math.sqrt((covarianceM2[0] + covarianceM2[2]) / 2) : NaN;
  const numbers = [...(xyM ?? [NaN, NaN]), headingRad, sigma];
  const cells = numbers.map((value) => (Number.isFinite(value) ? value.toFixed(6) : ""));
  return `${[(tS - zeroS).toFixed(6), ...cells, status, ...(level === undefined ? [] : [level])].join()}\n`;
}

// The way to a room, a door or another named place, on the floor that the walker is on or on another of its building.

/** @typedef {import("../../shared/map/points_of_interest.js").PointOfInterest} PointOfInterest */
/** @typedef {import("../../keeping/packages.js").WalkedFloor} WalkedFloor */
/** @typedef {{floor: WalkedFloor, point: PointOfInterest}} Goal */

/**
 * Offers the named places of a building.
 * @param {WalkedFloor[]} floors on this phone, that of the open map first @param {Goal | null} coming already chosen
 * @param {(goal: PointOfInterest | null, line: import("../../shared/map/projection.js").Point[]) => void} show on the map
 * @param {(level: number) => void} goOn the walker is on another floor now
 */
function offerWays(floors, coming, show, goOn) {
  const [here] = floors;
  const goals = goalsOf(floors);
  const passages = floors.flatMap((floor) => floor.passages);
  const once = [...new Map(passages.map((each) => [JSON.stringify(each), each])).values()];
  /** @type {{goal: Goal, ways: import("../../stages/ways.js").Ways} | null} */
  let wanted = null;
  /** @type {Fix | null} */
  let latest = null;
  let said = "";
  const choice = /** @type {HTMLSelectElement} */ (at("way-to"));
  const stepless = /** @type {HTMLInputElement} */ (at("way-stepless"));
  at("way").hidden = goals.length === 0;
  at("way-steps").hidden = once.length === withoutSteps(once).length;
  choice.replaceChildren(make("option", { value: "" }, [t("nowhere")]),
    ...goals.map((goal, k) => make("option", { value: String(k) }, [goalWords(goal, floors.length > 1)])));
  choice.onchange = stepless.onchange = () => {
    const goal = choice.value === "" ? null : goals[Number(choice.value)];
    wanted = goal && { goal, ways: waysTo(graph(), { level: goal.floor.level, xy_m: [goal.point.x_m, goal.point.y_m] }) };
    tell();
  };

  /** @type {Map<boolean, import("../../stages/ways.js").WayGraph>} */
  const graphs = new Map();
  function graph() {
    const walked = () => floors.map(({ level, xyM }) => ({ level, points: pointsOf(xyM) }));
    const made = graphs.get(stepless.checked) ?? wayGraphOf(walked(), stepless.checked ? withoutSteps(once) : once);
    graphs.set(stepless.checked, made);
    return made;
  }

  function tell() {
    const from_m = latest?.status === "OK" ? latest.xyM : null;
    const way = wanted && from_m ? wayFrom(wanted.ways, { level: here.level, xy_m: from_m }) : null;
    said = wanted ? words(wanted.goal, way, wanted.ways.goal.xy_m) : "";
    show(wanted?.goal.floor === here ? wanted.goal.point : null, way?.legs[0].line ?? []);
    at("way-words").textContent = said;
    at("way-words").hidden = wanted === null;
    offerNext(way);
  }

  /** @param {Goal} goal @param {import("../../stages/ways.js").Way | null} way @param {[number, number]} goal_m */
  function words({ floor, point }, way, goal_m) {
    const isHere = way ? way.legs.length === 1 : floor === here;
    return isHere ? wayWords(point.name, latest, way, goal_m)
      : floorWayWords(point.name, floor.level, latest, way, stepless.checked);
  }

  /** Once the way leaves this floor, or before it is known where. @param {import("../../stages/ways.js").Way | null} way */
  function offerNext(way) {
    const level = way ? way.legs[1]?.level : wanted?.goal.floor.level;
    const next = floors.find((floor) => floor !== here && floor.level === level);
    const button = at("way-next");
    button.hidden = !next;
    if (!next) return;
    const words = t("I am on {{floor}} now", { floor: theFloor(next.level) });
    if (button.textContent !== words) button.textContent = words;
    button.onclick = () => goOn(next.level);
  }

  const kept = goals.findIndex(({ floor, point }) => floor.map === coming?.floor.map && point.name === coming.point.name);
  if (kept >= 0) choice.value = String(kept);
  choice.dispatchEvent(new Event("change"));
  return {
    /** @returns {string} "" where nobody asks */
    words: () => said,
    /** @returns {Goal | null} */
    goal: () => wanted?.goal ?? null,
    /** @param {Fix | null} fix null before the first */
    fix(fix) {
      latest = fix;
      tell();
    },
  };
}

/** Those of the first floor first. @param {WalkedFloor[]} floors @returns {Goal[]} */
function goalsOf(floors) {
  return floors.flatMap((floor) => [...floor.pointsOfInterest].sort((one, other) => byName(one.name, other.name))
    .map((point) => ({ floor, point })));
}

/** @param {Goal} goal @param {boolean} isOfSeveral floors */
function goalWords({ floor, point }, isOfSeveral) {
  const kind = KIND_WORDS[point.kind] ?? point.kind;
  return `${point.name} (${isOfSeveral ? `${kind}, ${inSentence(floorName(floor.level))}` : kind})`;
}

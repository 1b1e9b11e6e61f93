/** What the page shows. Every function writes to the page, and none of them remembers anything. */

import { formatBytes, formatDuration, formatLevel, formatShare, formatWhen } from "../shared/format.js";
import { locale, t } from "../shared/words.js";
import { mayGoOn } from "./walking.js";

const BROKEN_OFF =
  t("This walk was broken off. Nothing is recorded until you go on; what was recorded is kept, and can be sent as it is.");
const BROKEN_OFF_LONG_AGO =
  t("This walk was broken off, too long ago to go on. What was recorded is kept: continue sending, and it becomes a map.");

/** @param {string} id @returns {any} */
export const at = (id) => document.getElementById(id);

const SIGNS = { pass: "✓", doubt: "?", fail: "✕" };
const SPOKEN = { pass: t("In order"), doubt: t("In doubt"), fail: t("Not in order") };

/** Shows one view and moves the reader to its heading. @param {string} id */
export function showView(id) {
  const views = /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll(".view"));
  for (const view of views) view.hidden = view.id !== id;
  at("unfinished").hidden = id !== "start" || at("unfinished-walks").children.length === 0;
  const heading = at(`${id}-title`);
  document.title = `${heading.textContent} · elfslam`;
  window.scrollTo(0, 0);
  heading.focus({ preventScroll: true });
}

/** One line above everything; null takes it away. @param {string | null} said @param {"fail" | "doubt" | "wait"} [verdict] */
export function showProblem(said, verdict = "fail") {
  at("problem").textContent = said ?? "";
  at("problem").dataset.verdict = verdict;
  at("problem").hidden = said === null;
  if (said !== null) window.scrollTo(0, 0);
}

/**
 * @param {string} tag @param {{data?: Record<string, string>, [property: string]: unknown}} properties
 * @param {(Node | string)[]} [children]
 */
export function make(tag, properties, children = []) {
  const { data = {}, ...rest } = properties;
  const element = Object.assign(document.createElement(tag), rest);
  Object.assign(element.dataset, data);
  element.append(...children);
  return element;
}

export function showListening() {
  at("probe-verdict").dataset.verdict = "wait";
  at("probe-verdict").firstElementChild.hidden = false;
  at("probe-said").textContent = t("Hold the phone as on a walk. Two seconds of chirps are played.");
  for (const id of ["probe-card", "go-on", "probe-again"]) at(id).hidden = true;
}

export function showTrying() {
  at("probe-said").textContent = t("Each microphone is tried for a second. Hold the phone as on a walk.");
}

/** @param {import("./microphone.js").Choice | null} choice null where there is one alone */
export function showMicrophones(choice) {
  at("microphones").hidden = choice === null;
  const options = (choice?.tried ?? []).map(({ deviceId, label, echoDb }) => {
    const level = echoDb === null ? t("not heard") : formatLevel(echoDb);
    return make("option", { value: deviceId, selected: deviceId === choice?.chosen, translate: false }, [`${label} · ${level}`]);
  });
  at("microphone").replaceChildren(...options);
}

/**
 * @param {import("./verdicts.js").Check[]} checks
 * @param {{verdict: string, said: string}} summary
 * @param {import("./probe.js").Subband[]} subbands
 */
export function showChecks(checks, summary, subbands) {
  at("probe-verdict").dataset.verdict = summary.verdict;
  at("probe-verdict").firstElementChild.hidden = true;
  at("probe-said").textContent = summary.said;
  at("checks").replaceChildren(...checks.map(checkLine));
  at("bands").replaceChildren(...subbands.map(bandColumn));
  at("bands").setAttribute("aria-label", bandsSpoken(subbands));
  at("probe-card").hidden = false;
  at("go-on").hidden = false;
  at("go-on").textContent = summary.verdict === "fail" ? t("Walk all the same") : t("Go on");
  at("go-on").classList.toggle("primary", summary.verdict !== "fail");
  at("probe-again").hidden = summary.verdict === "pass";
  at("probe-again").classList.toggle("primary", summary.verdict === "fail");
}

/** @param {import("./verdicts.js").Check} check */
function checkLine({ name, verdict, said }) {
  const sign = make("span", { className: "sign", ariaHidden: "true" }, [SIGNS[verdict]]);
  const spoken = make("span", { className: "visually-hidden" }, [`${SPOKEN[verdict]}: `]);
  const what = make("span", { className: "what" }, [spoken, name]);
  return make("li", { data: { verdict } }, [sign, what, make("span", { className: "said" }, [said])]);
}

const TALLEST_DB = 90;

/** @param {import("./probe.js").Subband} subband */
function bandColumn({ lowHz, snrDb }) {
  const verdict = snrDb < 6 ? "fail" : snrDb < 15 ? "doubt" : "pass";
  const bar = make("span", {});
  bar.style.setProperty("--share", String(Math.min(Math.max(snrDb / TALLEST_DB, 0.02), 1)));
  const column = make("div", { className: "column" }, [bar]);
  const value = make("strong", {}, [formatLevel(snrDb)]);
  return make("div", { data: { verdict } }, [value, column, `${lowHz / 1000} kHz`]);
}

/** @param {import("./probe.js").Subband[]} subbands */
function bandsSpoken(subbands) {
  const parts = subbands.map((band) => t("{{level}} at {{frequency}} kilohertz", { level: Math.round(band.snrDb), frequency: band.lowHz / 1000 }));
  return t("Decibels above the noise: {{levels}}", { levels: parts.join(", ") });
}

/** @param {import("./manifest.js").Facts} facts @param {number} keptBytes @param {number} sentBytes */
export function showFacts(facts, keptBytes, sentBytes) {
  at("clock").textContent = formatDuration(facts.seconds);
  at("steps").textContent = String(facts.steps);
  at("heard").dataset.chirps = String(facts.frames);
  at("heard").textContent =
    facts.frames > 0 ? formatShare((facts.frames - facts.missed) / facts.frames) : "–";
  at("kept").textContent = formatBytes(keptBytes);
  at("sent").textContent = formatBytes(sentBytes);
}

const SOFTEST_DB = -80;

/** @param {number} peak amplitude of the direct sound @param {boolean} isFound */
export function showLevel(peak, isFound) {
  const levelDb = 20 * Math.log10(Math.max(peak, 1e-5));
  const share = isFound ? Math.min(Math.max(1 - levelDb / SOFTEST_DB, 0), 1) : 0;
  const meter = at("level");
  meter.style.setProperty("--share", String(share));
  meter.dataset.verdict = isFound ? "pass" : "fail";
  meter.setAttribute("aria-valuenow", String(Math.round(isFound ? levelDb : SOFTEST_DB)));
  at("level-said").textContent = isFound ? formatLevel(levelDb) : t("not heard");
}

/** What is wrong with the chirps, and what to do about it; null takes it away. @param {string | null} said */
export function showChirps(said) {
  if (at("chirps-said").textContent === (said ?? "")) return;
  at("chirps-said").textContent = said ?? "";
  at("chirps-said").hidden = said === null;
}

/** @param {string | null} trouble @param {boolean} isBegun */
export function showNetwork(trouble, isBegun) {
  const said = trouble ?? (isBegun ? t("Connected. The walk is sent as you go.") : t("Connecting…"));
  at("network").dataset.verdict = trouble ? "doubt" : isBegun ? "pass" : "wait";
  if (at("network-said").textContent !== said) at("network-said").textContent = said;
}

/**
 * That a walk stands still, or what it lacks; null takes it away.
 * @param {string | null} said @param {boolean} [isStopped] nothing is recorded until the walker goes on
 */
export function showPause(said, isStopped = false) {
  at("pause-said").textContent = said ?? "";
  at("pause").dataset.verdict = isStopped ? "fail" : "doubt";
  at("pause").hidden = said === null;
  at("resume").hidden = !isStopped;
  at("recording-badge").textContent = isStopped ? t("Interrupted") : t("Recording");
  at("recording-badge").dataset.verdict = isStopped ? "wait" : "fail";
  if (said !== null) window.scrollTo(0, 0);
}

/** @param {string} said @param {number | null} share null where nobody knows */
export function showFinishing(said, share) {
  if (at("finish-said").textContent !== said) at("finish-said").textContent = said;
  if (share === null) at("finish-progress").removeAttribute("value");
  else at("finish-progress").value = share;
}

/** Where the walk is by now, as the heading of the last view. @param {string} title */
export function showStage(title) {
  if (at("finish-title").textContent === title) return;
  at("finish-title").textContent = title;
  document.title = `${title} · elfslam`;
}

/** @param {string | null} said */
export function showFinishTrouble(said) {
  at("finish-trouble").hidden = said === null;
  at("finish-trouble").firstElementChild.textContent = said ?? "";
}

/** @param {[string, string][]} facts */
export function showFinishFacts(facts) {
  const entries = facts.map(([name, value]) =>
    make("div", {}, [make("dt", {}, [name]), make("dd", {}, [value])]),
  );
  at("finish-facts").replaceChildren(...entries);
}

/** Shows those of the buttons of the last view that are of use. @param {string[]} ids */
export function offer(...ids) {
  for (const id of ["see-map", "send-again", "discard", "another"]) at(id).hidden = !ids.includes(id);
}

/**
 * @typedef {import("./sending.js").Sent} Sent
 * @typedef {Record<"goOn" | "send" | "discard", (sent: Sent) => void>} Ways out of an unfinished walk
 */
/** @param {Sent[]} walks @param {Ways} ways @param {number} nowMs */
export function showUnfinished(walks, ways, nowMs) {
  at("unfinished-title").textContent = walks.length > 1 ? t("Unfinished walks") : t("An unfinished walk");
  at("unfinished-walks").replaceChildren(...walks.map((sent) => unfinishedCard(sent, ways, nowMs)));
  at("unfinished").hidden = walks.length === 0 || at("start").hidden;
}

/** @param {Sent} sent @param {Ways} ways @param {number} nowMs */
function unfinishedCard(sent, ways, nowMs) {
  const { name, startUtc, facts } = sent.state;
  const bytes = totalBytes(sent.sizes);
  const told = `${formatWhen(startUtc)} · ${formatDuration(facts.seconds)} · ${formatBytes(bytes)}`;
  const canGoOn = mayGoOn(sent.state, nowMs);
  /** @param {string} text @param {keyof Ways} way @param {string} className */
  const button = (text, way, className) =>
    make("button", { type: "button", className, onclick: () => ways[way](sent) }, [text]);
  const buttons = make("div", { className: "row" }, [
    ...(canGoOn ? [button(t("Go on walking"), "goOn", "primary")] : []),
    button(t("Continue sending"), "send", canGoOn ? "" : "primary"),
    button(t("Discard"), "discard", "danger"),
  ]);
  return make("li", { className: "card walk" }, [
    make("h3", {}, [name]),
    make("p", { className: "soft" }, [told]),
    ...(sent.state.isOver ? [] : [make("p", {}, [canGoOn ? BROKEN_OFF : BROKEN_OFF_LONG_AGO])]),
    buttons,
  ]);
}

/** @param {Record<string, number>} sizes */
export function totalBytes(sizes) {
  return Object.values(sizes).reduce((sum, size) => sum + size, 0);
}

/** Asks before anything is deleted. @returns {Promise<boolean>} */
export function askDiscard() {
  const dialog = at("ask-discard");
  dialog.returnValue = "keep";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue === "discard"), { once: true });
  });
}

// What the walker says before the walk.

/**
 * The start pose from three texts; null where all are empty. Raises RangeError.
 * @param {string} x metres @param {string} y metres @param {string} heading degrees
 * @returns {number[] | null} x_m, y_m, heading_rad
 */
export function parseStart(x, y, heading) {
  const texts = [x, y, heading].map((text) => text.trim().replace(",", ".").replace("−", "-"));
  if (texts.every((text) => text === "")) return null;
  const numbers = texts.map((text) => (text === "" ? NaN : Number(text)));
  if (!numbers.every(Number.isFinite)) {
    throw new RangeError(t("Where it starts: give x, y and heading as numbers, or leave all three empty."));
  }
  const [xM, yM, degrees] = numbers;
  return [xM, yM, (degrees * Math.PI) / 180];
}

/** @param {Date} now @returns {string} a name for a walk that was given none */
export function usualName(now) {
  const day = now.toLocaleDateString(locale, { day: "numeric", month: "short" });
  if (now.getHours() < 12) return t("Morning walk, {{day}}", { day });
  return now.getHours() < 18 ? t("Afternoon walk, {{day}}", { day }) : t("Evening walk, {{day}}", { day });
}

/** @param {Date} now @param {number} random below 1 @returns {string} a key that sorts by time */
export function walkKey(now, random) {
  const time = now.toISOString().replace(/[-:]|\.\d+/g, "");
  return `${time}-${Math.floor(random * 0xffff).toString(16).padStart(4, "0")}`;
}

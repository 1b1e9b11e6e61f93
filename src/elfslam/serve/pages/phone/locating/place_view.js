/** What the view "Where am I" shows. Every function writes to the page, and none of them remembers anything. */

import { formatBytes, formatDuration, formatShare, formatWhen } from "../../shared/format.js";
import { at, make } from "../view.js";
import { WAITING, placeSpoken, theFloor, wordsOf } from "./words.js";
import { t } from "../../shared/words.js";

const SIGNS = { pass: "✓", doubt: "?", fail: "!", wait: "…" };

/**
 * @typedef {import("./choosing.js").MapRow} MapRow
 * @typedef {(row: MapRow, event: Event) => void} Deed
 * @typedef {{open: Deed, get: Deed, remove: Deed}} Deeds what the buttons of a map do
 */

/** @param {import("./words.js").Words} words */
export function showWords({ verdict, title, line }) {
  const status = at("place-status");
  const [sign, what, said] = status.children;
  status.dataset.verdict = verdict;
  sign.textContent = SIGNS[verdict];
  what.textContent = title;
  said.textContent = line;
}

/** Read aloud where it means something new: not at every footstep. @param {import("./words.js").Words} words */
export function speak({ title, line }) {
  at("place-spoken").textContent = `${title}. ${line}`;
}

/** @param {import("./words.js").Fix | null} fix @param {"track" | "one-shot"} mode @param {string} way "" where none is wanted */
export function speakPlace(fix, mode, way) {
  const { title } = fix ? wordsOf(fix) : WAITING[mode];
  const parts = [`${title}.`, fix && placeSpoken(fix), way && `${way}.`];
  at("place-spoken").textContent = parts.filter(Boolean).join(" ");
}

/** @param {{seconds: number, fixes: number, heardShare: number | null}} facts */
export function showPlaceFacts({ seconds, fixes, heardShare }) {
  at("place-clock").textContent = formatDuration(seconds);
  at("place-fixes").textContent = String(fixes);
  at("place-heard").textContent = heardShare === null ? "–" : formatShare(heardShare);
}

/** @param {string} name of the map @param {HTMLElement} stage */
export function showMap(name, stage) {
  at("place-title").textContent = name;
  at("place-map").replaceChildren(stage);
}

/**
 * The floors that a walker may say they are on. @param {number[]} levels @param {number} here that of the map shown
 * @param {(level: number) => void} say
 */
export function showFloors(levels, here, say) {
  const buttons = levels.length > 1 ? levels.map((level) => make("button", {
    type: "button", ariaPressed: String(level === here), onclick: () => say(level),
    ariaLabel: t("I am on {{floor}} now", { floor: theFloor(level) }),
  }, [String(level)])) : [];
  at("place-floors").replaceChildren(...buttons, at("place-stairs"));
  at("place-floors").hidden = buttons.length === 0;
}

/** @param {boolean} isRunning */
export function showRunning(isRunning) {
  at("place-stairs").hidden = !isRunning;
  at("place-stop").hidden = !isRunning;
  at("place-start").hidden = isRunning;
  at("place-facts").hidden = !isRunning && at("place-clock").textContent === "0:00";
  if (isRunning) at("place-save").hidden = true;
}

/** Offers the fixes of the walk that has ended as a file. @param {string} table */
export function offerFixes(table) {
  const link = at("place-save");
  URL.revokeObjectURL(link.href);
  link.href = URL.createObjectURL(new Blob([table], { type: "text/csv" }));
  link.hidden = false;
}

/** @param {string | null} said */
export function showMapsTrouble(said) {
  at("maps-trouble").hidden = said === null;
  at("maps-trouble").firstElementChild.textContent = said ?? "";
}

/** @param {{venue: string | null, rows: MapRow[]}[]} venues @param {Deeds} does */
export function showMaps(venues, does) {
  const hasVenues = venues.some(({ venue }) => venue !== null);
  at("maps-list").replaceChildren(...venues.flatMap(({ venue, rows }) => [
    ...(hasVenues ? [make("li", { className: "venue" }, [make("h2", {}, [venue ?? t("Elsewhere")])])] : []),
    ...rows.map((row) => mapCard(row, does, hasVenues ? "h3" : "h2")),
  ]));
  at("maps-none").hidden = venues.length > 0;
}

/** Whether a map is on its way to this phone. */
export function isGetting() {
  return document.querySelector("#maps-list [data-progress]:not([hidden])") !== null;
}

/** @param {MapRow} row @param {Deeds} does @param {"h2" | "h3"} heading */
function mapCard(row, does, heading) {
  /** @param {string} words @param {string} className @param {Deed} deed */
  const button = (words, className, deed) => {
    const onclick = (/** @type {Event} */ event) => deed(row, event);
    const inside = make("button", { type: "button", className, onclick }, [words]);
    inside.append(make("span", { className: "visually-hidden" }, [` ${row.name}`]));
    return inside;
  };
  const buttons = [
    row.isHere && button(t("Find me here"), "primary big", does.open),
    row.canGet && button(row.isHere ? t("Update") : t("Get this map"), row.isHere ? "" : "primary", does.get),
    row.isHere && button(t("Remove"), "danger", does.remove),
  ].filter((each) => each !== false);
  return make("li", { className: "card map-card", data: { map: row.id } }, [
    make("div", { className: "row apart" }, [make(heading, {}, [row.name]), badge(row)]),
    make("p", { className: "soft" }, [factsOf(row)]),
    make("div", { className: "stack tight", hidden: true, data: { progress: row.id } }, [
      make("progress", { max: 1, ariaLabel: t("Getting {{name}}", { name: row.name }) }),
      make("p", { className: "soft" }, []),
    ]),
    make("div", { className: "row" }, buttons),
  ]);
}

/** @param {MapRow} row */
function badge({ isHere, isOld }) {
  const [verdict, said] = isOld ? ["doubt", t("Update")] : isHere ? ["pass", t("On this phone")] : ["wait", t("On the server")];
  return make("span", { className: "badge", data: { verdict } }, [said]);
}

/** @param {MapRow} row */
function factsOf({ sizeBytes, when, floor, owner }) {
  const shared = owner && t("shared by {{owner}}", { owner });
  return [floor, shared, when && formatWhen(when), sizeBytes !== null && formatBytes(sizeBytes)].filter(Boolean).join(" · ");
}

/** Why the page itself does not open without a network, where it does not. */
export function showOffline() {
  const kept = document.documentElement.dataset.offline;
  at("maps-offline").hidden = kept === undefined || kept === "kept";
  at("maps-offline").textContent = at("maps-offline").hidden ? "" : kept;
}

/** @param {string} id @param {import("../../keeping/packages.js").Progress | null} progress */
export function showProgress(id, progress) {
  const found = document.querySelector(`[data-progress="${CSS.escape(id)}"]`);
  const box = /** @type {HTMLElement | null} */ (found);
  if (!box) return;
  box.hidden = progress === null;
  if (progress === null) return;
  const [bar, said] = box.children;
  const { doneBytes, totalBytes } = progress;
  /** @type {HTMLProgressElement} */ (bar).value = totalBytes > 0 ? doneBytes / totalBytes : 1;
  said.textContent = t("{{done}} of {{total}}", { done: formatBytes(doneBytes), total: formatBytes(totalBytes) });
}

/** Asks before a map is removed. @returns {Promise<boolean>} */
export function askRemove() {
  const dialog = at("ask-remove");
  dialog.returnValue = "keep";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => resolve(dialog.returnValue === "remove"), { once: true });
  });
}

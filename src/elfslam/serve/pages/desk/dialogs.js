// Dialogs: one question at a time, answered by keyboard or mouse; the focus goes back after.

import { h } from "../shared/dom.js";
import { counted, t } from "../shared/words.js";
import { courseOf, stretchField, stretchOf } from "./jobs_view.js";

/** So many names stand in a question; the others are counted. */
const MOST_NAMED = 8;

let count = 0;

/**
 * Show a form in a dialog; the answer is its data, or null when it was left.
 * @param {{title: string, body: any, submit: string, danger?: boolean, cancel?: string}} question
 * @returns {Promise<FormData | null>}
 */
export function askPerson({ title, body, submit, danger = false, cancel = t("Cancel") }) {
  count += 1;
  const id = `dialog-${count}`;
  const form = h("form", { method: "dialog" },
    h("h2", { id }, title),
    h("div", { class: "dialog-body" }, body),
    h("div", { class: "dialog-buttons" },
      h("button", { type: "button", class: "button", "data-leave": true }, cancel),
      h("button", { type: "submit", class: danger ? "button danger" : "button primary", value: "yes" }, submit)));
  const dialog = h("dialog", { "aria-labelledby": id }, form);
  return new Promise((resolve) => {
    form.querySelector("[data-leave]").addEventListener("click", () => dialog.close(""));
    dialog.addEventListener("close", () => {
      resolve(dialog.returnValue === "yes" ? new FormData(form) : null);
      dialog.remove();
    });
    document.body.append(dialog);
    dialog.showModal();
    if (danger) form.querySelector("[data-leave]").focus();
  });
}

/**
 * Show something until it is closed.
 * @param {string} title @param {any} body @returns {Promise<void>}
 */
export function showPerson(title, body) {
  count += 1;
  const id = `dialog-${count}`;
  const close = h("button", { type: "submit", class: "button primary" }, t("Close"));
  const dialog = h("dialog", { "aria-labelledby": id, class: "wide" },
    h("form", { method: "dialog" }, h("h2", { id }, title)),
    h("div", { class: "dialog-body" }, body),
    h("form", { method: "dialog", class: "dialog-buttons" }, close));
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve();
    });
    document.body.append(dialog);
    dialog.showModal();
    close.focus();
  });
}

/** @param {string} what @param {string} consequence @param {string[]} [names] of all that goes @returns {Promise<boolean>} */
export async function confirmDelete(what, consequence, names = []) {
  const more = names.length - MOST_NAMED;
  const body = [names.length > 0 && h("ul", { class: "plain" }, names.slice(0, MOST_NAMED).map((name) => h("li", null, name)), more > 0 && h("li", null, t("and {{count}} more", { count: more }))),
    h("p", null, consequence)];
  return (await askPerson({ title: t("Delete {{what}}?", { what }), body, submit: t("Delete for good"), danger: true, cancel: names.length > 1 ? t("Keep them") : t("Keep it") })) !== null;
}

/** One line at the foot of the page, read out by screen readers.
 * @param {string} text @param {"note" | "problem"} [kind] */
export function say(text, kind = "note") {
  const place = document.getElementById(kind === "problem" ? "problems" : "notes");
  if (!place) return;
  const line = h("p", { class: `toast ${kind}` }, h("span", null, text),
    h("button", { type: "button", class: "icon", "aria-label": t("Dismiss") }, "×"));
  line.querySelector("button").addEventListener("click", () => line.remove());
  place.replaceChildren(line);
  if (kind === "note") setTimeout(() => line.remove(), 6000);
}

/** Do something and say what went wrong, if it did.
 * @param {() => Promise<unknown>} deed @returns {Promise<boolean>} whether it went well */
export async function orSay(deed) {
  try {
    await deed();
    return true;
  } catch (problem) {
    say(problem instanceof Error ? problem.message : String(problem), "problem");
    return false;
  }
}

// The questions before a job: what to map by, what to merge, where to locate.

/** @typedef {import("./store.js").Recording} Recording */
/** @typedef {import("./store.js").Map_} Map_ */

const DEGREE = Math.PI / 180;

/** What can close loops, and the file that brings it. @type {[string, string, RegExp, string][]} */
const SENSES = [
  ["elf", t("Echoes"), /^(audio|frames|baseband)\./, t("the sound of the rooms")],
  ["magnetic", t("Magnetic field"), /^magnetometer\./, t("steel in the walls")],
  ["wifi", "Wi-Fi", /^wifi\./, t("access points and how strong they are")],
  ["emr", t("Mains hum"), /^emr\./, t("the hum of power lines")],
];

/** @param {string} words @param {Record<string, any>} attributes */
export function field(words, attributes) {
  return h("label", { class: "field" }, h("span", null, words), h("input", attributes));
}

/** @param {string} words @param {string} name @param {[string, string][]} choices */
function choice(words, name, choices) {
  return h("label", { class: "field" }, h("span", null, words),
    h("select", { name }, choices.map(([value, text]) => h("option", { value }, text))));
}

/** Which senses a recording brings. @param {Recording} recording @returns {string[]} */
export function sensesOf({ files }) {
  return SENSES.filter(([, , file]) => files.some(({ name }) => file.test(name))).map(([sense]) => sense);
}

/** @param {Recording} recording @param {import("./jobs_view.js").Span | null} [kept] what was mapped of it before
 * @returns {Promise<object | null>} the job to be posted */
export async function askToMap(recording, kept = null) {
  const course = courseOf(recording);
  const brought = sensesOf(recording);
  const ticks = SENSES.map(([sense, words, , why]) => {
    const has = brought.includes(sense);
    return h("label", { class: "tick" },
      h("input", { type: "checkbox", name: "by", value: sense, checked: has && sense === "elf", disabled: !has }),
      h("span", null, words, h("small", null, ` ${has ? why : t("not in this recording")}`)));
  });
  const body = [
    course && stretchField(course, kept ? [kept[0], Math.min(kept[1], course.duration_s)] : undefined),
    h("fieldset", null, h("legend", null, t("Close loops by")), h("div", { class: "ticks" }, ticks),
      h("small", null, t("With none of them the walk is reckoned from motion alone."))),
    h("fieldset", null, h("legend", null, t("Start")),
      h("label", { class: "tick" }, h("input", { type: "checkbox", name: "declared" }), h("span", null, t("The walk started here"))),
      h("div", { class: "fields" },
        field("x, m", { name: "x_m", type: "number", step: "any", value: "0" }),
        field("y, m", { name: "y_m", type: "number", step: "any", value: "0" }),
        field(t("Heading, degrees"), { name: "heading", type: "number", step: "any", value: "0" })),
      h("small", null, t("Heading: 0 along x, 90 along y. Without it the map begins at zero."))),
  ];
  const answer = await askPerson({ title: t("Map {{recording}}", { recording: recording.name }), body, submit: t("Map it") });
  return answer && mapJob(recording.id, answer, course?.duration_s);
}

/** @param {string} recording @param {FormData} answer @param {number} [duration_s] of the recording */
export function mapJob(recording, answer, duration_s) {
  const by = answer.getAll("by");
  const number = (/** @type {string} */ name) => Number(answer.get(name) || 0);
  const stretch = duration_s === undefined ? {} : stretchOf(number("from_s"), number("until_s"), duration_s);
  const job = { kind: "map", recording, by: by.length > 0 ? by : ["motion"], ...stretch };
  if (!answer.get("declared")) return job;
  return { ...job, start_pose: [number("x_m"), number("y_m"), number("heading") * DEGREE] };
}

/** @param {Map_[]} maps the chosen ones @returns {Promise<object | null>} */
export async function askToMerge(maps) {
  const body = [
    h("p", null, t("Walks that share places are laid over each other and become one floor map. What shares no place with the others is refused.")),
    h("ul", { class: "plain" }, maps.map((map) => h("li", null, map.name))),
    field(t("Name of the floor map"), { name: "name", required: true, maxlength: "120", value: commonName(maps) }),
  ];
  const answer = await askPerson({ title: counted(maps.length, "Merge {{count}} map", "Merge {{count}} maps"), body, submit: t("Merge") });
  return answer && { kind: "merge", maps: maps.map(({ id }) => id), name: String(answer.get("name")).trim() };
}

/** What the names share at their beginning. @param {{name: string}[]} maps */
export function commonName(maps) {
  const [first, ...rest] = maps.map(({ name }) => name);
  let length = first.length;
  for (const name of rest) while (!name.startsWith(first.slice(0, length))) length -= 1;
  return first.slice(0, length).replace(/[\s,;:._-]+$/, "") || t("Floor");
}

/** @param {Recording[]} recordings @param {Map_[]} maps @returns {Promise<object | null>} */
export async function askToLocate(recordings, maps) {
  const body = [
    choice(t("Recording"), "recording", recordings.map(({ id, name }) => [id, name])),
    choice(t("In the map"), "map", maps.map(({ id, name }) => [id, name])),
    choice(t("How"), "mode", [
      ["one-shot", t("One-shot: from 0.6 s of sound")],
      ["trajectory", t("Trajectory: from eight footsteps")],
      ["track", t("Track: as they walk, a fix per footstep")]]),
  ];
  const answer = await askPerson({ title: t("Locate a recording"), body, submit: t("Locate") });
  return answer && { kind: "locate", recording: answer.get("recording"), map: answer.get("map"), mode: answer.get("mode") };
}

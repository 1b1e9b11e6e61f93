// One map: the viewer, and beside it all that can be switched, placed, located and taken away.

import { Problem, request, requestJson } from "../shared/api.js";
import { h, icon } from "../shared/dom.js";
import { formatMetres, formatNumber, stageWords, withoutMarks } from "../shared/format.js";
import { placeOf } from "../shared/places.js";
import { counted, t, translated } from "../shared/words.js";
import { askToLocate, askToMap, confirmDelete, orSay, say, showPerson } from "./dialogs.js";
import { renameMap, smallButton } from "./lists.js";
import { deleteMap, downloadsOf, factsOf } from "./maps_view.js";
import { addressField, blankPage } from "./session.js";
import { sharedWords, shareMap } from "./sharing.js";
import { keptOf, recordedPart } from "./jobs_view.js";
import { mountCanvas } from "./viewer/canvas.js";
import { livePart } from "./viewer/live.js";
import { layerPart, legendOf, locatedPart, part, walkPart, pointsOf } from "./viewer/panel.js";
import { planOf, planType } from "./viewer/plan_panel.js";
import { sceneOf, firstState, parseFixes } from "./viewer/scene.js";

/** @typedef {import("./main.js").Desk} Desk */
/** @typedef {import("./store.js").Map_} Map_ */
/** @typedef {import("./main.js").Opened} Opened */

/** How a walk was located. @type {Record<string, string>} */
const MODES = { "one-shot": t("one-shot"), trajectory: t("trajectory"), track: t("track") };

/**
 * The page of a map, in `root`; null where nobody wants it any more once it has come. Throws Problem where
 * there is no such map.
 * @param {Desk} desk @param {string} id @param {HTMLElement} root @param {() => boolean} isWanted
 * @returns {Promise<Opened | null>}
 */
export async function openMap(desk, id, root, isWanted) {
  const path = `/api/maps/${encodeURIComponent(id)}`;
  const [first, view] = await Promise.all([requestJson(path), requestJson(`${path}/view`)]);
  if (!isWanted()) return null;
  /** @type {Map_} */
  let map = first;
  const scene = sceneOf(view);
  const state = firstState(scene);
  const panel = h("aside", { class: "panel", "aria-label": t("About this map") });
  const canvas = mountCanvas(scene, state, map.name, { onPlacement: (placement, finished) => plan.place(placement, finished), onTap: (xy_m) => (state.naming ? points : plan).tap(xy_m) });
  const canEdit = () => map.right !== "read";
  const plan = planOf(id, state, scene.bounds_m, { canEdit, redraw: canvas.redraw, changed: () => fillPanel("layers", "points", "plan"), showAll: canvas.showAll });
  const points = pointsOf(id, state, { canEdit, redraw: canvas.redraw, changed: () => fillPanel("layers", "points", "plan") });
  let legend = legendOf(scene, state);
  canvas.stage.append(legend, plan.bar, points.bar);

  function redraw() {
    const now = legendOf(scene, state);
    legend.replaceWith(now);
    legend = now;
    canvas.redraw();
  }

  const downloads = part(t("Downloads"), h("p", { class: "soft" }, t("Asking the server…")));
  const locate = h("button", { type: "button", class: "button", click: () => locateHere(desk, map) }, icon("locate"), t("Locate a recording"));
  let recording = recordingOf(desk, map);
  const parts = new Map();
  const makers = {
    layers: () => layerPart(scene, state, redraw),
    walks: () => walkPart(scene, state, redraw),
    located: () => locatedPart(state, redraw, locate),
    points: () => points.part(),
    plan: () => plan.part(),
    recorded: () => recordedPart(map, recording, () => mapAgain(desk, map, recording)),
  };

  /** @param {(keyof typeof makers)[]} names the parts to be made anew; the others keep their focus */
  function fillPanel(...names) {
    for (const name of names) {
      const now = makers[name]();
      if (parts.has(name)) parts.get(name).replaceWith(now);
      else panel.append(now);
      parts.set(name, now);
    }
    redraw();
  }

  fillPanel("layers", "walks", ...(desk.me ? [/** @type {const} */ ("located")] : []), "points", "plan", ...(desk.me ? [/** @type {const} */ ("recorded")] : []));
  const live = desk.me && livePart(id, state, canvas.redraw);
  panel.append(...(live ? [live.part] : []), ...(desk.me && map.right === "own" ? [programsPart(id)] : []), ...meetingPart(map), downloads);
  let head = headOfMap(desk, map, scene, look);
  root.replaceChildren(h("div", { class: "map-page" }, head, canvas.stage, panel));
  canvas.redraw();
  void fillDownloads(map, downloads);
  void orSay(points.load);
  if (map.floor_plan) void orSay(() => plan.load(map.floor_plan));
  const seen = new Set();
  const changed = () => {
    void look();
    void loadLocated(desk, id, seen, state, () => fillPanel("layers", "located"));
    const now = recordingOf(desk, map);
    if (now?.id === recording?.id) return;
    recording = now;
    fillPanel("recorded");
  };
  let isGone = false;

  /** What the server knows of it now: it may have been renamed, or be there no more. */
  async function look() {
    if (isGone || !isWanted()) return;
    try {
      const now = /** @type {Map_} */ (desk.known.maps.find((each) => each.id === id) ?? (await requestJson(path)));
      const [isSame, mayOther] = [headFacts(now) === headFacts(map), now.right !== map.right];
      map = now;
      if (isSame || isGone) return;
      const wanted = headOfMap(desk, map, scene, look);
      head.replaceWith(wanted);
      head = wanted;
      if (mayOther) fillPanel("points", "plan");
    } catch (problem) {
      if (problem instanceof Problem && problem.status === 404) leaveGone(problem.message);
    }
  }

  /** @param {string} why */
  function leaveGone(why) {
    if (isGone || !isWanted()) return;
    isGone = true;
    leave();
    root.replaceChildren(blankPage(t("This map is gone"), why, desk.me && h("a", { class: "button", href: "#/maps" }, t("Back to the maps"))));
    document.body.dataset.page = "gone";
  }

  function leave() {
    window.removeEventListener("pagehide", hide);
    if (!isGone) hide();
    if (live) live.leave();
    canvas.leave();
  }
  const hide = () => void plan.save();
  window.addEventListener("pagehide", hide);
  changed();
  return {
    changed,
    receive(files) {
      if (!canEdit()) return false;
      const image = files.find((file) => planType(file) !== undefined);
      if (image) void plan.upload(image);
      return image !== undefined;
    },
    leave() {
      if (!isGone) leave();
    },
  };
}

/** What of a map its head shows, as text. @param {Map_} map */
function headFacts({ name, venue, floor, right, owner, shared_with, has_link }) {
  return JSON.stringify([name, venue, floor, right, owner, shared_with, has_link]);
}

/** @param {Desk} desk @param {Map_} map @param {import("./viewer/scene.js").Scene} scene @param {() => Promise<void>} look */
function headOfMap(desk, map, { walks }, look) {
  const { closures, distance_m } = factsOf(map);
  const sum = (/** @type {(walk: import("./viewer/scene.js").Walk) => number} */ of) => walks.reduce((total, walk) => total + of(walk), 0);
  const facts = [placeOf(map), map.right !== "own" && t("shared by {{owner}}", { owner: map.owner }), map.kind === "floor" ? counted(walks.length, "Floor of {{count}} walk", "Floor of {{count}} walks") : t("One walk"), formatMetres(distance_m ?? sum((walk) => walk.length_m)),
    counted(sum((walk) => walk.xy_m.length), "{{count, number}} footstep", "{{count, number}} footsteps"), closures !== null && counted(closures, "{{count, number}} place passed again", "{{count, number}} places passed again"), map.right === "own" && sharedWords(map)];
  return h("header", { class: "map-head" },
    desk.me && h("a", { class: "button icon", href: "#/maps", "aria-label": t("Back to the maps"), title: t("Back to the maps") }, icon("back")),
    h("div", null, h("h1", { tabindex: "-1" }, map.name), h("p", { class: "soft" }, facts.filter(Boolean).join(" · "))),
    buttonsOf(desk, map, look));
}

/** What whoever is here may do with a map. @param {Desk} desk @param {Map_} map @param {() => Promise<void>} look */
function buttonsOf(desk, map, look) {
  const { name } = map;
  const button = (/** @type {Parameters<typeof icon>[0]} */ picture, /** @type {{short: string, whole: string}} */ words, /** @type {() => Promise<unknown>} */ deed, kind = "") =>
    h("button", { type: "button", class: `button icon ${kind}`.trim(), "aria-label": words.whole, title: words.short, click: deed }, icon(picture));
  const again = async () => {
    await desk.now();
    await look();
  };
  const rename = async () => (await renameMap(map, desk.known.maps)) && again();
  const share = async () => {
    await shareMap(map);
    await again();
  };
  const remove = async () => {
    if (!(await deleteMap(map))) return;
    location.hash = "#/maps";
    await desk.now();
  };
  return [
    desk.me === null && h("a", { class: "button primary find-me", href: `./${location.hash}` }, icon("locate"), t("Find me here")),
    map.right !== "read" && button("edit", { short: t("Rename"), whole: t("Rename {{name}}", { name }) }, rename),
    map.right === "own" && button("share", { short: t("Share"), whole: t("Share {{name}}", { name }) }, share),
    map.right === "own" && button("trash", { short: t("Delete"), whole: t("Delete {{name}}", { name }) }, remove, "danger"),
  ];
}

/** @param {Map_} map @param {HTMLElement} place */
async function fillDownloads(map, place) {
  try {
    place.lastElementChild?.replaceWith(await downloadsOf(map));
  } catch (problem) {
    place.lastElementChild?.replaceWith(h("p", { class: "problem" }, problem instanceof Error ? problem.message : String(problem)));
  }
}

/** @param {Desk} desk @param {Map_} map */
async function locateHere(desk, map) {
  const ready = desk.known.recordings.filter(({ state }) => state === "ready");
  if (ready.length === 0) return say(t("There is no recording to locate; record another walk first."), "problem");
  const job = await askToLocate(ready, [map]);
  if (!job) return undefined;
  const well = await orSay(() => requestJson("/api/jobs", { method: "POST", json: job }));
  if (well) say(t("It shows up here as soon as it is located."));
  return desk.now();
}

/** The recording that the map of a single walk was made of, while it is here. @param {Desk} desk @param {Map_} map */
function recordingOf(desk, { kind, sources }) {
  return kind === "run" ? desk.known.recordings.find(({ id, state }) => sources.includes(id) && state === "ready") : undefined;
}

/** @param {Desk} desk @param {Map_} map @param {import("./store.js").Recording | undefined} recording */
async function mapAgain(desk, map, recording) {
  const job = recording && (await askToMap(recording, keptOf(map.facts)));
  if (!job) return undefined;
  const well = await orSay(() => requestJson("/api/jobs", { method: "POST", json: job }));
  if (well) say(t("Another map of {{name}} is being made; this one stays.", { name: map.name }));
  return desk.now();
}

/** The walks located in this map, or in another of its building, that are not shown yet. @param {Desk} desk @param {string} id
 * @param {Set<string>} seen @param {import("./viewer/scene.js").State} state @param {() => void} fillPanel */
async function loadLocated(desk, id, seen, state, fillPanel) {
  const factsOf = (/** @type {string} */ map) => desk.known.maps.find((each) => each.id === map)?.facts ?? {};
  const here = factsOf(id);
  const isHere = (/** @type {string} */ map) => map === id || ("level" in here && "level" in factsOf(map) && factsOf(map).frame === here.frame);
  const jobs = desk.known.jobs.filter((job) => job.kind === "locate" && job.state === "done" && isHere(job.given.map) && !seen.has(job.id));
  for (const job of jobs) {
    seen.add(job.id);
    await orSay(async () => {
      const answer = await request(`/api/jobs/${encodeURIComponent(job.id)}/fixes.csv`);
      const name = desk.known.recordings.find((recording) => recording.id === job.given.recording)?.name ?? t("a deleted recording");
      const mode = job.given.mode ? ` (${MODES[job.given.mode] ?? job.given.mode})` : "";
      state.located.push({ id: job.id, name: `${name}${mode}`, fixes: parseFixes(await answer.text(), here.level), shown: state.located.length === 0 });
    });
  }
  if (jobs.length > 0) fillPanel();
}

// How the walks of a floor map fit together: which share places, and which were refused.

/** @typedef {{one: string, other: string, places: number, resemblance: number | null, outcome: string}} Pair */

/** Nothing for the map of a single walk. @param {import("./store.js").Map_} map @returns {any[]} */
function meetingPart({ facts }) {
  const pairs = /** @type {Pair[]} */ (Array.isArray(facts?.pairs) ? facts.pairs : []);
  const refused = Object.entries(facts?.refused ?? {});
  if (pairs.length === 0 && refused.length === 0) return [];
  const names = [...new Set([...pairs.flatMap(({ one, other }) => [one, other]), ...refused.map(([name]) => name)])];
  const shown = withoutMarks(names);
  const head = [t("Walks"), t("Places"), t("Similarity"), t("Outcome")].map((name) => h("th", { scope: "col" }, name));
  const rows = pairs.map(({ one, other, places, resemblance, outcome }) => h("tr", null,
    h("th", { scope: "row" }, t("{{one}} and {{other}}", { one: String(shown.get(one)), other: String(shown.get(other)) })), h("td", null, String(places)),
    h("td", null, Number.isFinite(resemblance) ? formatNumber(Number(resemblance), 2) : "–"), h("td", null, stageWords(outcome))));
  return [part(t("How the walks fit together"), [
    h("div", { class: "scroll" }, h("table", { class: "meetings", "aria-label": t("How the walks fit together") }, h("thead", null, h("tr", null, head)), h("tbody", null, rows))),
    refused.map(([name, why]) => h("p", { class: "problem" }, `${shown.get(name)}: ${translated(why)}`))])];
}

// For other programs: where on the Earth a map lies, and the webhooks to which positions in it are posted.

/** @typedef {{latitude_deg: number, longitude_deg: number, bearing_deg: number}} Origin */
/** @typedef {{is_on: boolean, origin: Origin | null}} Settings */
/** @typedef {{id: string, url: string, delivered: number, dropped: number, last_error: string | null}} Webhook */

const EAST_DEG = "90";
/** @type {[keyof Origin, string, number, string][]} */
const NUMBERS = [["latitude_deg", t("Latitude, °"), 89, "47.3769"], ["longitude_deg", t("Longitude, °"), 180, "8.5417"], ["bearing_deg", t("Bearing, °"), 360, EAST_DEG]];

/** The part of the panel that the owner of a map sees. @param {string} mapId */
export function programsPart(mapId) {
  const path = `/api/maps/${encodeURIComponent(mapId)}`;
  return part(t("Other programs"), [earthForm(path), webhooks(path)], "part-programs");
}

/** @param {string} path of the map */
function earthForm(path) {
  const status = h("p", { class: "soft saved", role: "status" });
  const inputs = new Map(NUMBERS.map(([name, , most, example]) =>
    [name, h("input", { name, type: "number", step: "any", min: -most, max: most, inputmode: "decimal", placeholder: example })]));
  const form = h("form", { class: "stack tight" },
    h("h3", null, t("Where the map lies on the Earth")),
    h("div", { class: "fields two" }, NUMBERS.map(([name, words]) => h("label", { class: "field" }, h("span", null, words), inputs.get(name)))),
    h("small", null, t("Of the map's origin; the bearing is that of its x axis, clockwise from north. Positions and exports then carry latitude and longitude. Leave all empty where it is not known.")),
    h("div", { class: "row" }, h("button", { type: "submit", class: "button small" }, t("Save")), status));

  /** @param {Settings} settings */
  function show({ origin }) {
    for (const [name, input] of inputs) input.value = origin ? String(origin[name]) : "";
  }

  /** @returns {Origin | null | undefined} null for nowhere, undefined where one is missing */
  function given() {
    if ([...inputs.values()].every(({ value }) => value === "")) return null;
    const bearing = inputs.get("bearing_deg");
    if (bearing.value === "") bearing.value = EAST_DEG;
    const numbers = [...inputs].map(([name, input]) => [name, input.valueAsNumber]);
    return numbers.every(([, number]) => Number.isFinite(number)) ? Object.fromEntries(numbers) : undefined;
  }

  form.addEventListener("submit", async (/** @type {Event} */ event) => {
    event.preventDefault();
    const origin = given();
    if (origin === undefined) {
      status.textContent = t("Latitude and longitude are wanted together.");
      return;
    }
    const well = await orSay(async () => {
      const now = await requestJson(`${path}/positions/settings`);
      show(await requestJson(`${path}/positions/settings`, { method: "PUT", json: { ...now, origin } }));
    });
    status.textContent = well ? t("Saved") : t("Not saved; try again");
  });
  void orSay(async () => show(await requestJson(`${path}/positions/settings`)));
  return form;
}

/** @param {string} path of the map */
function webhooks(path) {
  const list = h("ul", { class: "hooks" });
  const url = h("input", { type: "url", name: "webhook", required: true, maxlength: 2000, placeholder: "https://…", autocomplete: "off" });
  const form = h("form", { class: "stack tight" },
    h("label", { class: "field" }, h("span", null, t("Post positions to this address")), url),
    h("div", { class: "row" }, h("button", { type: "submit", class: "button small" }, icon("plus"), t("Add a webhook"))));

  async function load() {
    /** @type {Webhook[]} */
    const hooks = await requestJson(`${path}/webhooks`);
    list.replaceChildren(...hooks.map(row));
    list.hidden = hooks.length === 0;
  }

  /** @param {Webhook} hook */
  function row({ id, url: to, delivered, dropped, last_error: why }) {
    const told = [counted(delivered, "{{count, number}} delivered", "{{count, number}} delivered"), dropped > 0 && t("{{number}} dropped", { number: formatNumber(dropped, 0) }), why && translated(why)];
    return h("li", null, h("span", null, to, h("small", null, ` ${told.filter(Boolean).join(" · ")}`)),
      smallButton("trash", t("Delete {{name}}", { name: to }), () => remove(id, to), "danger"));
  }

  /** @param {string} id @param {string} to */
  async function remove(id, to) {
    if (!(await confirmDelete(to, t("Positions are posted there no more.")))) return;
    await orSay(async () => {
      await request(`${path}/webhooks/${encodeURIComponent(id)}`, { method: "DELETE" });
      await load();
    });
  }

  form.addEventListener("submit", (/** @type {Event} */ event) => {
    event.preventDefault();
    void orSay(async () => {
      const made = await requestJson(`${path}/webhooks`, { method: "POST", json: { url: url.value.trim() } });
      url.value = "";
      await load();
      await showPerson(t("The secret of this webhook"), [h("p", null, t("Every message is signed with it. It is shown once; give it to the program that receives.")), ...addressField(made.secret, t("Secret"))]);
    });
  });
  void orSay(load);
  return h("section", { class: "stack tight" }, h("h3", null, t("Webhooks")), list, form);
}

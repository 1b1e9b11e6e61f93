// The desk page: who is here, which page of it is open, and what it shows.

import { askJson } from "./api.js";
import { onDrop, uploader } from "./uploads.js";
import { orSay, say } from "./dialogs.js";
import { h, morph, one, onActions } from "../shared/dom.js";
import { icon } from "../shared/icons.js";
import { jobActions, jobsView } from "./jobs_view.js";
import { mapActions, mapsView } from "./maps_view.js";
import { openMap } from "./map_page.js";
import { openRecording } from "./recording/page.js";
import { recordingActions, recordingsView } from "./recordings_view.js";
import { pageOf } from "./routes.js";
import { pairAnother } from "./codes.js";
import { signOut, whoIsHere } from "./session.js";
import { pairWith, secretIn } from "../shared/api.js";
import { isOpen, keepKnown } from "./store.js";
import { userActions, usersView } from "./users_view.js";

/**
 * @typedef {object} Desk what every page of the desk can use
 * @property {import("./store.js").Known} known
 * @property {ReturnType<typeof uploader>} uploads
 * @property {Set<string>} chosen maps to be merged
 * @property {import("./users_view.js").User[]} users
 * @property {() => Promise<void>} now ask the server again
 * @property {() => void} render
 * @property {() => number} nowMs
 */

/** @typedef {{changed: () => void, receive: (files: File[]) => boolean, leave: () => void}} Opened a page that
 * looks after itself; `receive` takes dropped files, or does not want them */

const VIEWS = { recordings: recordingsView, jobs: jobsView, maps: mapsView, users: usersView };
const ACTIONS = { recordings: recordingActions, jobs: jobActions, maps: mapActions, users: userActions };
const TITLES = { recordings: "Recordings", jobs: "Jobs", maps: "Maps", users: "People", map: "Map", recording: "Recording" };

/** Pages of one thing: who opens them, their list, and what is said where it cannot be shown. */
const THINGS = {
  map: { open: openMap, list: "maps", waiting: "map-page waiting", lost: "This map cannot be shown", back: "Back to the maps" },
  recording: { open: openRecording, list: "recordings", waiting: "page waiting", lost: "This recording cannot be shown", back: "Back to the recordings" },
};

/** @param {import("./session.js").Me} me */
function openDesk(me) {
  const main = one("main");
  /** @type {Opened | null} */
  let thing = null;
  let shown = "";
  let opened = 0;

  const { known, now } = keepKnown(() => {
    render();
    thing?.changed();
  }, showConnection);

  /** @type {Desk} */
  const desk = {
    known,
    chosen: new Set(),
    users: [],
    render,
    nowMs: () => Date.now(),
    uploads: uploader(() => render(), () => void now()),
    async now() {
      if (me.is_owner && pageOf(location.hash).name === "users") await loadUsers();
      await now();
      render();
    },
  };

  async function loadUsers() {
    await orSay(async () => {
      desk.users = await askJson("/api/users");
    });
  }

  /** The list that is open, brought up to date. A page of one thing looks after itself. */
  function render() {
    countJobs(known);
    const { name } = pageOf(location.hash);
    if (name === "map" || name === "recording" || name !== shown) return;
    const wanted = h("main", { id: "main" }, VIEWS[name](desk));
    morph(main, wanted);
    tickBoxes(main, desk);
  }

  /** Whatever comes late, as maps do, is shown only as long as nothing else was opened. */
  async function open() {
    const { name, id } = pageOf(location.hash);
    const turn = ++opened;
    const isWanted = () => turn === opened;
    thing?.leave();
    thing = null;
    shown = name;
    document.title = `${TITLES[name]} · elfslam`;
    document.body.dataset.page = name;
    for (const link of document.querySelectorAll("nav a")) {
      const here = link.getAttribute("href") === `#/${name === "map" || name === "recording" ? THINGS[name].list : name}`;
      if (here) link.setAttribute("aria-current", "page");
      else link.removeAttribute("aria-current");
    }
    if (name === "map" || name === "recording") await showThing(THINGS[name], id, isWanted);
    else {
      main.replaceChildren();
      if (name === "users") await loadUsers();
      render();
    }
    if (!isWanted()) return;
    main.querySelector("h1")?.focus({ preventScroll: true });
    scrollTo(0, 0);
  }

  /** @param {typeof THINGS.map | typeof THINGS.recording} kind @param {string} id @param {() => boolean} isWanted */
  async function showThing(kind, id, isWanted) {
    main.replaceChildren(h("div", { class: kind.waiting, "aria-busy": "true" }));
    try {
      thing = (await kind.open(desk, id, main, isWanted)) ?? thing;
    } catch (problem) {
      if (!isWanted()) return;
      const words = problem instanceof Error ? problem.message : String(problem);
      main.replaceChildren(h("div", { class: "empty" }, h("h1", { tabindex: "-1" }, kind.lost), h("p", null, words),
        h("a", { class: "button", href: `#/${kind.list}` }, kind.back)));
    }
  }

  for (const [name, actions] of Object.entries(ACTIONS)) {
    const deeds = /** @type {Record<string, (id: string, element: HTMLElement) => void>} */ (actions(desk));
    onActions(main, Object.fromEntries(Object.entries(deeds).map(([action, deed]) =>
      [action, (id, element) => pageOf(location.hash).name === name && deed(id, element)])));
  }
  main.addEventListener("change", (/** @type {Event} */ event) => {
    const input = /** @type {HTMLInputElement} */ (event.target);
    if (input.name !== "recordings" || !input.files) return;
    desk.uploads.send(input.files);
    input.value = "";
  });
  onDrop((files) => {
    if (thing?.receive(files)) return;
    if (pageOf(location.hash).name !== "recordings") location.hash = "#/recordings";
    desk.uploads.send(files);
  });
  window.addEventListener("hashchange", () => void open());
  window.addEventListener("beforeunload", (event) => {
    if (desk.uploads.isBusy()) event.preventDefault();
  });
  showWho(me);
  void open();
  void now();
}

/** What a person ticked is no attribute: set it again. @param {HTMLElement} main @param {Desk} desk */
function tickBoxes(main, desk) {
  for (const box of main.querySelectorAll('[data-action="choose"]')) {
    const input = /** @type {HTMLInputElement} */ (box);
    input.checked = desk.chosen.has(input.dataset.id ?? "");
  }
}

/** @param {import("./store.js").Known} known */
function countJobs(known) {
  const open = known.jobs.filter(isOpen).length;
  const badge = one("#jobs-open");
  badge.hidden = open === 0;
  badge.textContent = String(open);
  badge.setAttribute("aria-label", `${open} to do`);
}

/** @param {unknown | null} problem */
function showConnection(problem) {
  const place = one("#connection");
  place.hidden = problem === null;
  if (problem !== null) place.textContent = problem instanceof Error ? problem.message : String(problem);
}

/** @param {import("./session.js").Me} me */
function showWho(me) {
  one("#who").replaceChildren(h("a", { class: "button icon", href: "./", "aria-label": "Walk with this device", title: "Walk with this device" }, icon("phone")),
    h("span", { class: "name" }, me.name),
    h("button", { type: "button", class: "button small quiet", click: () => void pairAnother() }, "Pair a device"),
    h("button", { type: "button", class: "button small quiet", click: async () => {
    if (await orSay(signOut)) location.reload();
  } }, "Sign out"));
  one("#nav-users").hidden = !me.is_owner;
  one("nav").hidden = false;
}

/** Nobody is known: say how to come in. */
function showDoor() {
  one("nav").hidden = true;
  one("#who").replaceChildren();
  const input = h("input", { name: "code", required: true, autocomplete: "off", spellcheck: "false", placeholder: "https://…/#token=…" });
  const form = h("form", { class: "card" },
    h("h1", null, "This browser is not paired"),
    h("p", null, "Open the address that ", h("code", null, "elfslam serve"), " printed in its terminal, with all that follows the ", h("code", null, "#"), ", or one that “Pair a device” shows on a desk that is paired."),
    h("label", { class: "field" }, h("span", null, "Or paste it here"), input),
    h("div", { class: "row" }, h("button", { type: "submit", class: "button primary" }, "Pair")));
  form.addEventListener("submit", async (/** @type {Event} */ event) => {
    event.preventDefault();
    if (await orSay(() => pairWith(input.value))) location.reload();
    else say("This code opens nothing here; copy it whole.", "problem");
  });
  document.body.dataset.page = "door";
  one("main").replaceChildren(h("div", { class: "door" }, form));
}

async function start() {
  window.addEventListener("hashchange", () => {
    if (secretIn(location.hash) !== null) location.reload();
  });
  try {
    const me = await whoIsHere();
    if (me === null) return showDoor();
    document.addEventListener("elfslam:signed-out", () => location.reload(), { once: true });
    return openDesk(me);
  } catch (problem) {
    one("main").replaceChildren(h("div", { class: "empty" }, h("h1", null, "The desk cannot be opened"), h("p", null, problem instanceof Error ? problem.message : String(problem)),
      h("button", { type: "button", class: "button", click: () => location.reload() }, "Try again")));
    return undefined;
  }
}

void start();

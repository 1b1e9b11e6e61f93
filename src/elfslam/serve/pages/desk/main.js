// The desk page: who is here, which page of it is open, and what it shows.

import { Problem, linkIn, openLink, requestJson, secretIn } from "../shared/api.js";
import { h, morph, onActions, one } from "../shared/dom.js";
import { languageChoice, t } from "../shared/words.js";
import { orSay } from "./dialogs.js";
import { jobActions, jobsView } from "./jobs_view.js";
import { choosing, firstOrder, forgetGone, tickBoxes } from "./lists.js";
import { openMap } from "./map_page.js";
import { mapActions, mapsView } from "./maps_view.js";
import { openRecording } from "./recording_page.js";
import { recordingActions, recordingsView, onDrop, uploader } from "./recordings_view.js";
import { blankPage, pageOf, showDoor, showWho, whoIsHere, userActions, usersView } from "./session.js";
import { isOpen, keepKnown, poll } from "./store.js";

/**
 * @typedef {object} Desk what every page of the desk can use
 * @property {import("./session.js").Me | null} me nobody, where a link alone opened a map
 * @property {import("./store.js").Known} known
 * @property {ReturnType<typeof uploader> | null} uploads
 * @property {Set<string>} chosen rows of lists
 * @property {Record<string, import("./lists.js").Order>} orders of lists
 * @property {import("./session.js").User[]} users
 * @property {() => Promise<void>} now ask the server again
 * @property {() => void} render
 * @property {() => number} nowMs
 */

/** @typedef {{changed: () => void, receive: (files: File[]) => boolean, leave: () => void}} Opened a page that
 * looks after itself; `receive` takes dropped files, or does not want them
 */

const VIEWS = { recordings: recordingsView, jobs: jobsView, maps: mapsView, users: usersView };
const ACTIONS = { recordings: recordingActions, jobs: jobActions, maps: mapActions, users: userActions };
const TITLES = { recordings: t("Recordings"), jobs: t("Jobs"), maps: t("Maps"), users: t("People"), map: t("Map"), shared: t("Map"), recording: t("Recording"), missing: t("No such page") };

/** Pages of one thing: who opens them, their list, and what is said where it is gone or cannot be shown. */
const THINGS = {
  map: { open: openMap, list: "maps", waiting: "map-page waiting", gone: t("This map is not here"), lost: t("This map cannot be shown"), back: t("Back to the maps") },
  recording: { open: openRecording, list: "recordings", waiting: "page waiting", gone: t("This recording is not here"), lost: t("This recording cannot be shown"), back: t("Back to the recordings") },
};

/** @param {import("./session.js").Me} me */
function openDesk(me) {
  const main = one("main");
  /** @type {Opened | null} */
  let thing = null;
  let shown = "";
  let opened = 0;

  const { known, now } = keepKnown(() => {
    if (me.is_owner && shown === "users") void loadUsers().then(render);
    forgetGone(desk.chosen, [...known.recordings, ...known.maps]);
    render();
    thing?.changed();
  }, showConnection);

  const uploads = uploader(() => render(), () => void now());
  /** @type {Desk} */
  const desk = {
    me,
    known,
    uploads,
    chosen: new Set(),
    orders: { recordings: firstOrder(), jobs: firstOrder(), maps: firstOrder() },
    users: [],
    render,
    nowMs: () => Date.now(),
    async now() {
      await now();
      render();
    },
  };

  async function loadUsers() {
    await orSay(async () => {
      desk.users = await requestJson("/api/users");
    });
  }

  /** The list that is open, brought up to date. A page of one thing looks after itself. */
  function render() {
    countJobs(known);
    const { name } = pageOf(location.hash);
    if (!(name in VIEWS) || name !== shown) return;
    const view = VIEWS[/** @type {keyof typeof VIEWS} */ (name)];
    morph(main, h("main", { id: "main", tabindex: "-1" }, view(desk)));
    tickBoxes(main, desk.chosen);
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
    document.body.dataset.page = name === "shared" ? "map" : name;
    markNavigation(name);
    if (name === "map" || name === "recording") await showThing(THINGS[name], async () => id, isWanted);
    else if (name === "shared") await showThing(THINGS.map, async () => (await openLink(id)).map, isWanted);
    else if (name === "missing") main.replaceChildren(blankPage(t("There is no such page"), t("The desk has no page at this address; it may have been cut off where it was copied."), h("a", { class: "button", href: "#/recordings" }, t("To the recordings"))));
    else {
      main.replaceChildren();
      if (name === "users") await loadUsers();
      render();
    }
    if (!isWanted()) return;
    main.querySelector("h1")?.focus({ preventScroll: true });
    scrollTo(0, history.state?.scrolledPx ?? 0);
  }

  /** @param {typeof THINGS.map | typeof THINGS.recording} kind @param {() => Promise<string>} idOf which one @param {() => boolean} isWanted */
  async function showThing(kind, idOf, isWanted) {
    main.replaceChildren(h("div", { class: kind.waiting, "aria-busy": "true" }));
    try {
      thing = (await kind.open(desk, await idOf(), main, isWanted)) ?? thing;
    } catch (problem) {
      if (!isWanted()) return;
      const isGone = problem instanceof Problem && problem.status === 404;
      main.replaceChildren(blankPage(isGone ? kind.gone : kind.lost, problem instanceof Error ? problem.message : String(problem),
        h("a", { class: "button", href: `#/${kind.list}` }, kind.back)));
    }
  }

  onActions(main, choosing(main, desk.chosen, render));
  for (const [name, actions] of Object.entries(ACTIONS)) {
    const deeds = /** @type {Record<string, (id: string, element: HTMLElement) => void>} */ (actions(desk));
    onActions(main, Object.fromEntries(Object.entries(deeds).map(([action, deed]) =>
      [action, (id, element) => pageOf(location.hash).name === name && deed(id, element)])));
  }
  main.addEventListener("input", (/** @type {Event} */ event) => {
    const input = /** @type {HTMLInputElement | HTMLSelectElement} */ (event.target);
    const order = desk.orders[shown];
    if (!input.dataset.order || !order) return;
    Object.assign(order, { [input.dataset.order]: input.value });
    render();
  });
  main.addEventListener("change", (/** @type {Event} */ event) => {
    const input = /** @type {HTMLInputElement} */ (event.target);
    if (input.name !== "recordings" || !input.files) return;
    uploads.send(input.files);
    input.value = "";
  });
  onDrop((files) => {
    if (thing?.receive(files)) return;
    if (pageOf(location.hash).name !== "recordings") location.hash = "#/recordings";
    uploads.send(files);
  });
  window.addEventListener("hashchange", () => void open());
  keepScrolled();
  window.addEventListener("beforeunload", (event) => {
    if (uploads.isBusy()) event.preventDefault();
  });
  showWho(me);
  void open();
  void now();
}

/** Each address of the history knows how far down it was scrolled, so that Back finds the list where it was. */
function keepScrolled() {
  history.scrollRestoration = "manual";
  window.addEventListener("scrollend", () => history.replaceState({ scrolledPx: scrollY }, ""));
}

/** @param {string} name of the page that is open */
function markNavigation(name) {
  for (const link of document.querySelectorAll("nav a")) {
    const isHere = link.getAttribute("href") === `#/${name === "map" || name === "recording" ? THINGS[name].list : name}`;
    if (isHere) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}

/** @param {import("./store.js").Known} known */
function countJobs(known) {
  const open = known.jobs.filter(isOpen).length;
  const badge = one("#jobs-open");
  badge.hidden = open === 0;
  badge.textContent = String(open);
  badge.setAttribute("aria-label", t("{{count}} to do", { count: open }));
}

/** @param {unknown | null} problem */
function showConnection(problem) {
  const place = one("#connection");
  place.hidden = problem === null;
  if (problem !== null) place.textContent = problem instanceof Error ? problem.message : String(problem);
}

async function start() {
  one("#foot").replaceChildren(languageChoice());
  one(".skip").addEventListener("click", (/** @type {Event} */ event) => {
    event.preventDefault(); // an address of the desk stands behind the #
    one("main").focus();
  });
  window.addEventListener("hashchange", () => {
    if (secretIn(location.hash) !== null) location.reload();
  });
  try {
    const me = await whoIsHere();
    const link = linkIn(location.hash);
    if (me === null) {
      window.addEventListener("hashchange", () => location.reload());
      return link === null ? showDoor() : await openGuest(link);
    }
    document.addEventListener("elfslam:signed-out", () => location.reload(), { once: true });
    return openDesk(me);
  } catch (problem) {
    one("main").replaceChildren(blankPage(t("The desk cannot be opened"), problem instanceof Error ? problem.message : String(problem),
      h("button", { type: "button", class: "button", click: () => location.reload() }, t("Try again"))));
    return undefined;
  }
}

void start();

// A map that was shared by link, for who has no account: the map, and nothing else of the desk.

/** Knows nothing but what it is told. @type {Desk} */
const DESK = {
  me: null,
  known: { recordings: [], jobs: [], maps: [], loaded: false },
  uploads: null,
  chosen: new Set(),
  orders: {},
  users: [],
  now: async () => {},
  render: () => {},
  nowMs: () => Date.now(),
};

/** @param {string} link what the address has behind `#link=` */
async function openGuest(link) {
  const main = one("main");
  one("nav").hidden = true;
  one("#who").replaceChildren(...one("#foot").childNodes); // beside a map the foot is not seen
  document.body.dataset.page = "map";
  document.title = t("Map · elfslam");
  try {
    const { map: id, name } = await openLink(link);
    document.title = `${name} · elfslam`;
    const page = await openMap(DESK, id, main, () => true);
    const look = async () => {
      page?.changed();
      return false;
    };
    void poll(look, () => {}).now();
  } catch (problem) {
    document.body.dataset.page = "gone";
    main.replaceChildren(blankPage(t("This link opens nothing"), problem instanceof Error ? problem.message : String(problem),
      h("button", { type: "button", class: "button", click: () => location.reload() }, t("Try again"))));
  }
}

// A map that was shared by link, for who has no account: the map, and nothing else of the desk.

import { blankPage } from "./door.js";
import { openMap } from "./map_page.js";
import { poll } from "./polling.js";
import { openLink } from "../shared/api.js";
import { h, one } from "../shared/dom.js";
import { t } from "../shared/words.js";

/** Knows nothing but what it is told. @type {import("./main.js").Desk} */
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
export async function openGuest(link) {
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

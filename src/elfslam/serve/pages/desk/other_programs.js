// For other programs: where on the Earth a map lies, and the webhooks to which positions in it are posted.

import { request, requestJson } from "../shared/api.js";
import { addressField } from "./session.js";
import { confirmDelete, orSay, showPerson } from "./dialogs.js";
import { h, icon } from "../shared/dom.js";
import { formatNumber } from "../shared/format.js";
import { smallButton } from "./lists.js";
import { part } from "./viewer/panel.js";
import { counted, t, translated } from "../shared/words.js";

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

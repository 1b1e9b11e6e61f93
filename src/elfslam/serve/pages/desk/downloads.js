// What a map can be taken away as. What it does not hold is refused in the server's own words.

import { download, requestJson } from "../shared/api.js";
import { h, icon } from "../shared/dom.js";
import { fileName } from "../shared/format.js";
import { t } from "../shared/words.js";

/** What each format is for. @type {Record<string, string>} */
const WORDS = {
  tum: t("TUM trajectory: a pose per line, for evo and other tools"),
  g2o: t("g2o pose graph: steps and closures, for other optimisers"),
  onnx: t("ONNX encoder: what others are located by"),
  geojson: t("GeoJSON: walks, spots and coverage on the Earth"),
  imdf: t("IMDF: the walked ground as a unit of a venue"),
  ros: t("ROS map: the walked ground as an image, for robots"),
  parquet: t("Parquet: the spots as a table"),
};

/** Formats that lie on the Earth. */
const PLACED = ["geojson", "imdf"];
const KEPT = "elfslam-export-";

/** What IMDF asks for beside the origin. @type {[string, string, string][]} */
const VENUE = [
  ["name", t("Venue"), ""], ["category", t("Category"), "businesscampus"], ["address", t("Address"), ""], ["locality", t("Town"), ""],
  ["country", t("Country, such as CH"), ""], ["level", t("Name of the level"), t("Ground floor")], ["ordinal", t("Level, 0 at the ground"), "0"],
];

/** What a format is asked for with: what was filled in. @param {string} format @param {Map<string, HTMLInputElement>} inputs */
export function queryOf(format, inputs) {
  const names = format === "imdf" ? ["origin", ...VENUE.map(([name]) => name)] : format === "geojson" ? ["origin"] : [];
  const given = names.map((name) => [name, inputs.get(name)?.value.trim() ?? ""]).filter(([, value]) => value !== "");
  return given.length > 0 ? `?${new URLSearchParams(given)}` : "";
}

/** What a map knows of the venue itself. @param {{venue?: string | null, floor?: string | null, level?: number | null}} map
 * @returns {Record<string, string>} */
export function venueOf({ venue, floor, level }) {
  const known = { name: venue, level: floor, ordinal: level };
  return Object.fromEntries(Object.entries(known).filter(([, told]) => told !== null && told !== undefined).map(([name, told]) => [name, String(told)]));
}

/** Everything of one map, ready for a dialog or a panel.
 * @param {{id: string, name: string, venue?: string | null, floor?: string | null, level?: number | null}} map */
export async function downloadsOf(map) {
  const path = `/api/maps/${encodeURIComponent(map.id)}`;
  /** @type {string[]} */
  const formats = await requestJson(`${path}/exports`);
  const known = venueOf(map);
  const inputs = new Map([["origin", keptInput("origin", "", undefined, "47.3769,8.5417,90")],
    ...VENUE.map(([name, , value]) => /** @type {[string, HTMLInputElement]} */ ([name, keptInput(name, value, known[name])]))]);
  return h("div", { class: "downloads" },
    h("div", { class: "row" },
      h("a", { class: "button", href: `${path}/report.html`, target: "_blank", rel: "noopener" }, icon("report"), t("Report")),
      h("a", { class: "button", href: `${path}/map.zip`, download: `${fileName(map.name)}.zip` }, icon("download"), t("Whole folder"))),
    h("ul", { class: "exports" }, formats.map((format) => exportLine(map, path, format, inputs))),
    formats.some((format) => PLACED.includes(format)) && h("label", { class: "field" },
      h("span", null, t("Where on the Earth")), inputs.get("origin"),
      h("small", null, t("Latitude, longitude and bearing of the map's x axis; GeoJSON and IMDF ask for it where the map has no place on the Earth."))),
    formats.includes("imdf") && h("details", null, h("summary", null, t("About the venue, for IMDF")),
      h("div", { class: "fields two" }, VENUE.map(([name, words]) => h("label", { class: "field" }, h("span", null, words), inputs.get(name))))));
}

/** A field that remembers, as long as the tab is open; what the map knows comes first. @param {string} name
 * @param {string} value @param {string} [known] @param {string} [placeholder] @returns {HTMLInputElement} */
function keptInput(name, value, known, placeholder) {
  const input = h("input", { name, placeholder, autocomplete: "off", spellcheck: "false" });
  input.value = known ?? sessionStorage.getItem(KEPT + name) ?? value;
  input.addEventListener("change", () => sessionStorage.setItem(KEPT + name, input.value.trim()));
  return input;
}

/** @param {{id: string, name: string}} map @param {string} path @param {string} format
 * @param {Map<string, HTMLInputElement>} inputs */
function exportLine(map, path, format, inputs) {
  const refusal = h("p", { class: "problem", role: "status" });
  const button = h("button", { type: "button", class: "button small", "data-format": format, "aria-label": t("Download as {{format}}", { format }) }, icon("download"), format);
  button.addEventListener("click", async () => {
    refusal.textContent = "";
    button.setAttribute("aria-busy", "true");
    try {
      await download(`${path}/exports/${encodeURIComponent(format)}${queryOf(format, inputs)}`, `${fileName(map.name)}.${format}`);
    } catch (problem) {
      refusal.textContent = problem instanceof Error ? problem.message : String(problem);
    }
    button.removeAttribute("aria-busy");
  });
  return h("li", null, button, h("div", null, h("span", null, WORDS[format] ?? ""), refusal));
}

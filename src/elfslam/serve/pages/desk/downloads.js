// What a map can be taken away as. What it does not hold is refused in the server's own words.

import { askJson, download } from "./api.js";
import { h } from "./dom.js";
import { fileName } from "./format.js";
import { icon } from "./icons.js";

/** What each format is for. @type {Record<string, string>} */
const WORDS = {
  tum: "TUM trajectory: a pose per line, for evo and other tools",
  g2o: "g2o pose graph: steps and closures, for other optimisers",
  onnx: "ONNX encoder: what others are located by",
  geojson: "GeoJSON: walks, spots and coverage on the Earth",
  imdf: "IMDF: the walked ground as a unit of a venue",
  ros: "ROS map: the walked ground as an image, for robots",
  parquet: "Parquet: the spots as a table",
};

/** Formats that lie on the Earth. */
const PLACED = ["geojson", "imdf"];
const ORIGIN = "elfslam-origin";

/** Everything of one map, ready for a dialog or a panel. @param {{id: string, name: string}} map */
export async function downloadsOf(map) {
  const path = `/api/maps/${encodeURIComponent(map.id)}`;
  /** @type {(string | {name: string})[]} */
  const told = await askJson(`${path}/exports`);
  const formats = told.map((format) => (typeof format === "string" ? format : format.name));
  const origin = h("input", { name: "origin", placeholder: "47.3769,8.5417,90", autocomplete: "off", spellcheck: "false" });
  origin.value = sessionStorage.getItem(ORIGIN) ?? "";
  origin.addEventListener("change", () => sessionStorage.setItem(ORIGIN, origin.value.trim()));
  return h("div", { class: "downloads" },
    h("div", { class: "row" },
      h("a", { class: "button", href: `${path}/report.html`, target: "_blank", rel: "noopener" }, icon("report"), "Report"),
      h("a", { class: "button", href: `${path}/map.zip`, download: `${fileName(map.name)}.zip` }, icon("download"), "Whole folder")),
    h("ul", { class: "exports" }, formats.map((format) => exportLine(map, path, format, origin))),
    formats.some((format) => PLACED.includes(format)) && h("label", { class: "field" },
      h("span", null, "Where on the Earth"), origin,
      h("small", null, "Latitude, longitude and bearing of the map's x axis; GeoJSON and IMDF ask for it.")));
}

/** @param {{id: string, name: string}} map @param {string} path @param {string} format
 * @param {HTMLInputElement} origin */
function exportLine(map, path, format, origin) {
  const refusal = h("p", { class: "problem", role: "status" });
  const button = h("button", { type: "button", class: "button small", "data-format": format, "aria-label": `Download as ${format}` }, icon("download"), format);
  button.addEventListener("click", async () => {
    refusal.textContent = "";
    button.setAttribute("aria-busy", "true");
    const query = PLACED.includes(format) && origin.value.trim() ? `?origin=${encodeURIComponent(origin.value.trim())}` : "";
    try {
      await download(`${path}/exports/${encodeURIComponent(format)}${query}`, `${fileName(map.name)}.${format}`);
    } catch (problem) {
      refusal.textContent = problem instanceof Error ? problem.message : String(problem);
    }
    button.removeAttribute("aria-busy");
  });
  return h("li", null, button, h("div", null, h("span", null, WORDS[format] ?? ""), refusal));
}

// QR codes of addresses that pair a device.

import { requestJson } from "../shared/api.js";
import { orSay, say, showPerson } from "./dialogs.js";
import { h, icon, svg } from "../shared/dom.js";
import { qrcode } from "../vendor/qrcode-generator/qrcode.mjs";
import { t } from "../shared/words.js";

const QUIET_MODULES = 4;

/** Shows a code that pairs one more device with whoever is here. */
export async function pairAnother() {
  await orSay(async () => {
    const { url, expires_s: expires } = await requestJson("/api/pairing", { method: "POST" });
    const what = t("Scan it with your other device, or open the address there, within {{minutes}} minutes. It works once.", { minutes: Math.round(expires / 60) });
    await showPerson(t("Pair another device"), invitation(url, what));
  });
}

/** What a dialog shows of an address that pairs. @param {string} url @param {string} what to do with it */
export function invitation(url, what) {
  return [h("p", null, what), codeOf(url), ...addressField(url)];
}

/** An address or another text, and what copies it. @param {string} text @param {string} [label] */
export function addressField(text, label = t("Address")) {
  const address = h("input", { readonly: true, value: text, "aria-label": label, name: "address" });
  const copy = h("button", { type: "button", class: "button" }, icon("copy"), t("Copy it"));
  copy.addEventListener("click", async () => {
    address.select();
    const well = await navigator.clipboard?.writeText(text).then(() => true, () => false);
    say(well ? t("It is in the clipboard.") : t("It is selected; copy it with the keyboard."));
  });
  return [address, h("div", { class: "row" }, copy)];
}

/** @param {string} text @returns {SVGElement} a QR code, dark on white in any theme */
export function codeOf(text) {
  const code = qrcode(0, "M");
  code.addData(text);
  code.make();
  const count = code.getModuleCount();
  let path = "";
  for (let row = 0; row < count; row += 1) {
    for (let column = 0; column < count; column += 1) {
      if (code.isDark(row, column)) path += `M${column + QUIET_MODULES} ${row + QUIET_MODULES}h1v1h-1z`;
    }
  }
  const side = count + 2 * QUIET_MODULES;
  return svg("svg", { viewBox: `0 0 ${side} ${side}`, class: "code", role: "img", "aria-label": t("QR code of the address"), "shape-rendering": "crispEdges" },
    svg("rect", { width: side, height: side, fill: "#fff" }), svg("path", { d: path, fill: "#000" }));
}

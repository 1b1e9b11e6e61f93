// The fingerprint of the server's authority, as the terminal shows it.

import { t } from "./shared/words.js";

const CERTIFICATE = /-----BEGIN CERTIFICATE-----([A-Za-z0-9+/=\s]+)-----END CERTIFICATE-----/;
const SHOWN_PAIRS = 4;

/** SHA-256 of a certificate: pairs of digits with colons. @param {string} pem @returns {Promise<string>} */
export async function fingerprintOf(pem) {
  const text = CERTIFICATE.exec(pem)?.[1];
  if (!text) throw new Error(t("The server sent no certificate."));
  const content = Uint8Array.from(atob(text.replace(/\s/g, "")), (letter) => letter.charCodeAt(0));
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", content));
  return [...digest].map((byte) => byte.toString(16).padStart(2, "0").toUpperCase()).join(":");
}

async function show() {
  const response = await fetch("authority.pem");
  if (!response.ok) throw new Error(t("This server speaks plain HTTP and has no certificate of its own: there is nothing to install."));
  const whole = await fingerprintOf(await response.text());
  const pairs = whole.split(":");
  /** @param {string} id @param {string} text */
  const write = (id, text) => {
    const place = document.getElementById(id);
    if (place) place.textContent = text;
  };
  write("fingerprint", `${pairs.slice(0, SHOWN_PAIRS).join(":")} … ${pairs.slice(-SHOWN_PAIRS).join(":")}`);
  write("whole-fingerprint", whole);
}

if (globalThis.document?.getElementById("fingerprint")) {
  show().catch((error) => {
    const problem = document.getElementById("problem");
    if (!problem) return;
    problem.textContent = error.message;
    problem.hidden = false;
  });
}

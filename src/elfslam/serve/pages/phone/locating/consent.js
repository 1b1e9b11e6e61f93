/** The switch by which a walker lets others see where they are: off at first, and off when locating ends. */

import { ask } from "../../shared/api.js";
import { at } from "../view.js";
import { startTelling } from "./telling.js";
import { t } from "../../shared/words.js";

const OFFER = t("Let others see where I am");
const DELETED = t("Deleted: the server knows no place of yours any more.");
const UNHEARD = t("No answer: nothing is sent now.");

/**
 * The button by which a walker has the server delete where they were.
 * @param {{act: (work: () => Promise<void>) => (event?: Event) => Promise<void>}} given
 */
export function offerDeletion({ act }) {
  at("positions-forget").addEventListener("click", act(async () => {
    await ask("DELETE", "/api/positions");
    at("positions-forget-help").textContent = DELETED;
  }));
}

/**
 * @param {{problem: (said: string | null) => void}} given
 * @returns {{offer: (map: string, name: string, nowS: () => number) => void,
 *   fix: (fix: import("./words.js").Fix) => void, withdraw: () => void}} offer: once locating has begun
 */
export function makeConsent({ problem }) {
  /** @type {{map: string, name: string, nowS: () => number} | null} */
  let offered = null;
  /** @type {ReturnType<typeof startTelling> | null} */
  let telling = null;
  const box = at("place-tell");
  const input = /** @type {HTMLInputElement} */ (at("place-tell-switch"));

  function show(trouble = "") {
    box.hidden = offered === null;
    input.checked = telling !== null;
    box.dataset.verdict = telling ? "doubt" : "wait";
    at("place-tell-words").textContent = telling && offered ? t("Others see where you are: {{name}}", { name: offered.name }) : OFFER;
    if (at("place-tell-trouble").textContent !== trouble) at("place-tell-trouble").textContent = trouble;
    at("place-tell-trouble").hidden = trouble === "";
    at("place-sent").textContent = telling ? t("Positions are sent") : t("Nothing is sent");
  }

  function end() {
    telling?.end();
    telling = null;
    show();
  }

  function begin() {
    if (!offered) return;
    telling = startTelling({
      ...offered,
      send: (message, more) => ask("POST", "/api/positions", message, {}, more),
      trouble(error, isFinal) {
        if (isFinal) end();
        if (isFinal) problem(/** @type {Error} */ (error).message);
        else show(error ? UNHEARD : "");
      },
    });
    show();
  }

  input.addEventListener("change", () => (input.checked ? begin() : end()));
  window.addEventListener("pagehide", end);
  return {
    offer(map, name, nowS) {
      offered = { map, name, nowS };
      show();
    },
    fix: (fix) => telling?.fix(fix),
    withdraw() {
      end();
      offered = null;
      show();
    },
  };
}

/** The switch by which a walker lets others see where they are: off at first, when locating ends, and when the floor changes. */

import { ask } from "../../shared/api.js";
import { t } from "../../shared/words.js";
import { at } from "../view.js";

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
  /** @type {ReturnType<typeof startPublishing> | null} */
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
    telling = startPublishing({
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

// Telling others where the walker is: what is sent of fixes, how often, and what is never sent late.

/**
 * @typedef {import("./words.js").Fix} Fix
 * @typedef {{age_s: number, status: string, x_m?: number, y_m?: number, heading_rad?: number, sigma_m?: number}} Told
 * @typedef {{map: string, walk: string, positions: Told[], is_over?: boolean}} Message
 */

/** Two fixes a second at most: the latest of each half. */
const APART_S = 0.5;
const EVERY_MS = 1000;
/** What is older is of no use to anybody and is not sent. */
const OLDEST_S = 5;
const PATIENCE_MS = 4000;
const WALK_BYTES = 8;
/** With these the server says that asking again is no use. */
const FINAL = [400, 401, 403, 404, 409, 422];

/** @param {Fix[]} waiting @param {Fix} fix @returns {Fix[]} */
export function withLatest(waiting, fix) {
  const last = waiting[waiting.length - 1];
  const isSameHalf = last !== undefined && Math.floor(last.tS / APART_S) === Math.floor(fix.tS / APART_S);
  return [...(isSameHalf ? waiting.slice(0, -1) : waiting), fix];
}

/** @param {Fix[]} waiting @param {number} nowS on the clock of the fixes @returns {Fix[]} */
export function fresh(waiting, nowS) {
  return waiting.filter(({ tS }) => nowS - tS <= OLDEST_S);
}

/** A fix as the server takes it; what is not known is left out. @param {Fix} fix @param {number} nowS @returns {Told} */
export function toldOf({ tS, xyM, headingRad, covarianceM2, status }, nowS) {
  return {
    age_s: Math.max(nowS - tS, 0),
    status,
    ...(xyM && { x_m: xyM[0], y_m: xyM[1] }),
    ...(xyM && Number.isFinite(headingRad) && { heading_rad: headingRad }),
    ...(xyM && covarianceM2 && { sigma_m: Math.sqrt(Math.max(covarianceM2[0] + covarianceM2[2], 0) / 2) }),
  };
}

/** A name for this walk alone, which says nothing of the phone. */
export function newWalk() {
  const bytes = crypto.getRandomValues(new Uint8Array(WALK_BYTES));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}

/**
 * Fixes go out once a second until the end. While the server does not answer they are dropped.
 * @param {{
 *   map: string, nowS: () => number,
 *   send: (message: Message, more: {signal?: AbortSignal, keepalive?: boolean}) => Promise<unknown>,
 *   trouble: (error: (Error & {status?: number}) | null, isFinal: boolean) => void,
 * }} given nowS: on the clock of the fixes; trouble: of each message, null where it was taken
 */
export function startPublishing({ map, nowS, send, trouble }) {
  const walk = newWalk();
  /** @type {Fix[]} */
  let waiting = [];
  let isSending = false;
  let isOver = false;

  async function turn() {
    waiting = fresh(waiting, nowS());
    if (isSending || waiting.length === 0) return;
    const positions = waiting.map((fix) => toldOf(fix, nowS()));
    waiting = [];
    isSending = true;
    const giveUp = new AbortController();
    const patience = setTimeout(() => giveUp.abort(), PATIENCE_MS);
    const outcome = await send({ map, walk, positions }, { signal: giveUp.signal }).then(() => null, (error) => error);
    clearTimeout(patience);
    isSending = false;
    if (!isOver) trouble(outcome, outcome !== null && FINAL.includes(outcome.status));
  }

  const timer = setInterval(turn, EVERY_MS);
  return {
    /** @param {Fix} fix */
    fix(fix) {
      waiting = withLatest(waiting, fix);
    },
    /** What is shown of this walk goes at once. */
    end() {
      isOver = true;
      clearInterval(timer);
      send({ map, walk, positions: [], is_over: true }, { keepalive: true }).catch(() => {});
    },
  };
}

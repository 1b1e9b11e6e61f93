/** Telling others where the walker is: what is sent of fixes, how often, and what is never sent late. */

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
export function startTelling({ map, nowS, send, trouble }) {
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

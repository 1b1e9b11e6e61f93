// Asking again and again: often while something moves, seldom while nothing does.

/** @typedef {{fast_ms: number, slow_ms: number, growth: number}} Pace */

/** @type {Pace} */
export const PACE = { fast_ms: 1000, slow_ms: 20_000, growth: 1.6 };

/**
 * The wait before the next question.
 * @param {number} last_ms the wait before this one @param {boolean} moving @param {Pace} [pace]
 * @returns {number} ms
 */
export function nextWait(last_ms, moving, pace = PACE) {
  if (moving) return pace.fast_ms;
  return Math.min(pace.slow_ms, Math.max(pace.fast_ms, last_ms * pace.growth));
}

/**
 * Ask now and go on asking, never twice at a time, not while the page is hidden.
 * @param {() => Promise<boolean>} question gives whether something moves; may throw
 * @param {(problem: unknown | null) => void} tell each outcome: null, or what went wrong
 * @returns {{now: () => Promise<void>}} `now` asks at once and resets the wait
 */
export function poll(question, tell) {
  let wait_ms = PACE.fast_ms;
  let timer = 0;
  /** @type {Promise<void> | null} */
  let running = null;
  let again = false;

  async function turn() {
    let moving = false;
    try {
      moving = await question();
      tell(null);
    } catch (problem) {
      tell(problem);
    }
    wait_ms = nextWait(wait_ms, moving);
  }

  function arm() {
    clearTimeout(timer);
    if (!document.hidden) timer = setTimeout(now, wait_ms);
  }

  /** @returns {Promise<void>} */
  function now() {
    clearTimeout(timer);
    if (running) {
      again = true;
      return running;
    }
    running = turn().then(() => {
      running = null;
      if (again) {
        again = false;
        return now();
      }
      arm();
    });
    return running;
  }

  document.addEventListener("visibilitychange", () => {
    wait_ms = PACE.fast_ms;
    if (document.hidden) clearTimeout(timer);
    else void now();
  });
  return {
    now() {
      wait_ms = PACE.fast_ms;
      return now();
    },
  };
}

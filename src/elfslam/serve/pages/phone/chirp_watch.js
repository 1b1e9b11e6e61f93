/** What is wrong with the chirps while a walk is recorded, and what to do about it on this phone. Pure. */

/** Two seconds of chirps are judged together: one that is lost says nothing. */
const WINDOW = 20;
const HEARD_SHARE = 0.5;
/** Of full scale, as the check before the walk has them. */
const SOFT = 0.004;
const HARDLY = 0.0005;
/** A quarter of what it was at its best: the phone has begun to work on the sound, or something covers it. */
const FADED = 0.25;
/** @type {Record<string, string>} settings of the microphone that must be off */
const DISTORTIONS = {
  echoCancellation: "echo cancellation", noiseSuppression: "noise suppression", autoGainControl: "automatic gain",
};

/**
 * Judges each chirp with those before it; gives what to say, null where all is well or too little was heard yet.
 * @param {() => MediaTrackSettings} settings of the microphone at this moment
 * @param {string} userAgent
 * @returns {(peak: number, isFound: boolean) => string | null}
 */
export function makeChirpWatch(settings, userAgent) {
  /** @type {{peak: number, isFound: boolean}[]} */
  let recent = [];
  let best = 0;
  return (peak, isFound) => {
    recent = [...recent, { peak, isFound }].slice(-WINDOW);
    if (recent.length < WINDOW) return null;
    const found = recent.filter((each) => each.isFound).map((each) => each.peak).sort((one, other) => one - other);
    const level = found[found.length >> 1] ?? 0;
    best = Math.max(best, level);
    return wrongWith(settings()) ?? tooSoft(found.length / WINDOW, level, best, louderOn(userAgent));
  };
}

/** @param {Record<string, any>} settings */
function wrongWith(settings) {
  const on = Object.keys(DISTORTIONS).filter((key) => settings[key] === true || typeof settings[key] === "string");
  if (on.length === 0) return null;
  return `The browser has switched ${on.map((key) => DISTORTIONS[key]).join(" and ")} on, which wipes out the chirps. ` +
    "End a call that uses the microphone, or use another browser.";
}

/** @param {number} heardShare @param {number} level @param {number} best @param {string} louder */
function tooSoft(heardShare, level, best, louder) {
  if (heardShare < HEARD_SHARE) return `The chirps are not heard. ${louder} Uncover loudspeaker and microphone.`;
  if (level < HARDLY) return `The chirps are hardly heard. ${louder}`;
  if (level < FADED * best) {
    return `The chirps have become much softer. Uncover loudspeaker and microphone, and look at the volume. If that ` +
      "does not help, this browser takes them for noise: use another one.";
  }
  return level < SOFT ? `The chirps are soft. ${louder}` : null;
}

/** How to turn chirps up on this phone. @param {string} userAgent */
export function louderOn(userAgent) {
  if (/iPhone|iPad|iPod/.test(userAgent)) return "Press the volume button now, and switch the silent mode off.";
  if (/Android/.test(userAgent)) return "Press the volume button now, and turn up “media”.";
  return "Turn the volume up.";
}

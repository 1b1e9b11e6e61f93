/** What is wrong with the chirps while a walk is recorded, and what to do about it on this phone. Pure. */

import { t } from "../shared/words.js";

/** Two seconds of chirps are judged together: one that is lost says nothing. */
const WINDOW = 20;
const HEARD_SHARE = 0.5;
/** Of full scale, as the check before the walk has them. */
const SOFT = 0.004;
const HARDLY = 0.0005;
/** A quarter of what it was at its best: the phone has begun to work on the sound, or something covers it. */
const FADED = 0.25;
/** Settings of the microphone that must be off, as far as browsers may switch them on by themselves. */
const DISTORTIONS = ["echoCancellation", "noiseSuppression", "autoGainControl"];

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
  const isOn = DISTORTIONS.some((key) => settings[key] === true || typeof settings[key] === "string");
  return isOn ? t("The browser has begun to work on the sound, which wipes out the chirps. End a call that uses the microphone, or use another browser.") : null;
}

/** @param {number} heardShare @param {number} level @param {number} best @param {string} louder */
function tooSoft(heardShare, level, best, louder) {
  if (heardShare < HEARD_SHARE) return t("The chirps are not heard. {{louder}} Uncover loudspeaker and microphone.", { louder });
  if (level < HARDLY) return t("The chirps are hardly heard. {{louder}}", { louder });
  if (level < FADED * best) {
    return t("The chirps have become much softer. Uncover loudspeaker and microphone, and look at the volume. If that does not help, this browser takes them for noise: use another one.");
  }
  return level < SOFT ? t("The chirps are soft. {{louder}}", { louder }) : null;
}

/** How to turn chirps up on this phone. @param {string} userAgent */
export function louderOn(userAgent) {
  if (/iPhone|iPad|iPod/.test(userAgent)) return t("Press the volume button now, and switch the silent mode off.");
  if (/Android/.test(userAgent)) return t("Press the volume button now, and turn up “media”.");
  return t("Turn the volume up.");
}

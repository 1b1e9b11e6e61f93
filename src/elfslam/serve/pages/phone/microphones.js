/**
 * Which of several microphones listens: each is tried with chirps, and the one that hears most of their echoes is kept
 * for this phone. One that hears no chirps, as a headset's, is never chosen but by hand.
 */

const KEPT = "elfslam-microphone";
/** Another one must hear so much more than the one that the browser gave. */
const AHEAD_DB = 3;

/**
 * @typedef {{deviceId: string, label: string, echoDb: number | null}} Tried echoDb: null where it heard no chirps
 * @typedef {{chosen: string, isByHand: boolean, tried: Tried[]}} Choice
 * @typedef {import("./microphone.js").Microphone} Microphone
 */

/** What was chosen on this phone before. @returns {Choice | null} */
export function keptChoice() {
  try {
    return JSON.parse(localStorage.getItem(KEPT) ?? "null");
  } catch {
    return null;
  }
}

/** @param {Choice} choice */
function keep(choice) {
  try {
    localStorage.setItem(KEPT, JSON.stringify(choice));
  } catch {
    // a browser that keeps nothing tries them again
  }
  return choice;
}

/**
 * The choice between those that are there, null where there is one alone; the microphone listens to it then.
 * @param {Microphone} microphone
 * @param {() => Promise<import("./probe.js").Measured>} hear measures chirps
 * @param {() => void} trying is told before each is tried, which takes a second
 */
export async function chooseMicrophone(microphone, hear, trying) {
  const there = await microphonesThere();
  if (there.length < 2) return null;
  const given = microphone.track.getSettings().deviceId;
  const kept = keptChoice();
  if (kept && isStillGood(kept, there)) {
    if (given !== kept.chosen) await microphone.listenTo(kept.chosen);
    return kept;
  }
  trying();
  /** @type {Tried[]} */
  const tried = [];
  for (const { deviceId, label } of there) {
    tried.push({ deviceId, label, echoDb: await echoDbOf(microphone, deviceId, hear) });
  }
  const { deviceId: chosen } = bestOf(tried, given);
  await microphone.listenTo(chosen);
  return keep({ chosen, isByHand: false, tried });
}

/** @param {Microphone} microphone @param {Choice} choice @param {string} chosen by hand */
export async function chooseByHand(microphone, choice, chosen) {
  await microphone.listenTo(chosen);
  return keep({ ...choice, chosen, isByHand: true });
}

/** The one that hears most, but the given one where no other is well ahead. @param {Tried[]} tried @param {string} [given] */
export function bestOf(tried, given) {
  /** @param {Tried} one */
  const level = ({ echoDb }) => echoDb ?? -Infinity;
  const usual = tried.find(({ deviceId }) => deviceId === given) ?? tried[0];
  const loudest = tried.reduce((best, one) => (level(one) > level(best) ? one : best));
  return level(loudest) > level(usual) + AHEAD_DB ? loudest : usual;
}

/** One that is listed as the default and by its own name, too, counts once. @returns {Promise<MediaDeviceInfo[]>} */
async function microphonesThere() {
  const listed = (await navigator.mediaDevices.enumerateDevices()).filter(({ kind }) => kind === "audioinput");
  /** @param {MediaDeviceInfo} one */
  const isAnother = ({ deviceId, groupId }) =>
    deviceId === "default" && listed.some((other) => other.deviceId !== deviceId && other.groupId === groupId);
  return listed.filter((one) => one.deviceId !== "communications" && !isAnother(one));
}

/** @param {Choice} choice @param {MediaDeviceInfo[]} there */
function isStillGood({ chosen, isByHand, tried }, there) {
  const ids = there.map(({ deviceId }) => deviceId);
  const isSame = ids.length === tried.length && tried.every(({ deviceId }) => ids.includes(deviceId));
  return ids.includes(chosen) && (isSame || isByHand);
}

/** @param {Microphone} microphone @param {string} deviceId @param {() => Promise<import("./probe.js").Measured>} hear */
async function echoDbOf(microphone, deviceId, hear) {
  try {
    await microphone.listenTo(deviceId);
  } catch {
    return null; // it is held elsewhere, or gone
  }
  return (await hear()).echoDb ?? (await hear()).echoDb; // what has just been opened may begin late
}

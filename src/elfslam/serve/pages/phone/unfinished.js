/** Walks that an earlier page left behind: made whole again, so that they can be sent or discarded. */

import { BASEBAND } from "./baseband.js";
import { TABLE_FILES, SOUND_FILES, cutsFor, lastTime } from "./mending.js";
import { closeWalk } from "./walking.js";

const WHOLE_FRAME_S = 0.08;

/**
 * @typedef {import("./keeper.js").Keeper} Keeper
 * @typedef {import("./manifest.js").Walk} Walk
 * @typedef {import("./sending.js").Sent} Sent
 */

/**
 * @param {Keeper} keeper
 * @returns {Promise<Sent[]>} walks that hold anything; empty ones are cleared away
 */
export async function findUnfinished(keeper) {
  /** @type {{walk: string, state: Walk | null, sizes: Record<string, number>}[]} */
  const found = await keeper.ask({ do: "list" });
  const walks = [];
  for (const { walk, state, sizes } of found) {
    if (state === null) await keeper.ask({ do: "remove", walk });
    else walks.push(makeSent(keeper, walk, state, sizes));
  }
  return walks;
}

/** Bytes held beside the state of a walk, so that it can be closed when the phone is full. */
const RESERVE = 1 << 15;

/**
 * @param {Keeper} keeper @param {string} walk @param {Walk} state @param {Record<string, number>} sizes
 * @returns {Sent}
 */
export function makeSent(keeper, walk, state, sizes) {
  const save = (reserve = state.isOver ? 0 : RESERVE) => keeper.ask({ do: "save", walk, state, reserve });
  return { walk, state, sizes, save };
}

/**
 * A walk that nobody stopped is cut to what is whole, and closed.
 * @param {Sent} sent @param {Keeper} keeper @param {string} software
 */
export async function mend(sent, keeper, software) {
  if (sent.state.isOver) return;
  await mendFiles(sent, keeper);
  await closeWalk(sent, keeper, software);
}

/**
 * Cuts the files of a walk that nobody stopped to what is whole: it may be closed, or go on. What was cut is sent
 * anew, as the server may have had more of it.
 * @param {Sent} sent @param {Keeper} keeper
 */
export async function mendFiles(sent, keeper) {
  const { walk, state, sizes } = sent;
  const { table, file, headerBytes } = SOUND_FILES[state.kind];
  /** @param {string} name */
  const text = async (name) => {
    const bytes = await keeper.ask({ do: "read", walk, name, start: 0, end: sizes[name] ?? 0 });
    return new TextDecoder().decode(bytes);
  };
  const frames = await text(table);
  /** @type {Record<string, string>} */
  const tables = {};
  for (const name of TABLE_FILES) tables[name] = await text(name);
  const frameBytes = frameBytesOf(state);
  const cuts = cutsFor(
    { table: frames, frameBytes, headerBytes, fileBytes: sizes[file] ?? 0 },
    tables,
  );
  /** @param {string} name @param {number | undefined} size */
  const cut = async (name, size) => {
    if (size === undefined) return;
    await keeper.ask({ do: "truncate", walk, name, size });
    sizes[name] = size;
    delete state.uploads[name];
  };
  await cut(table, cuts.sound.table);
  await cut(file, cuts.sound.file);
  for (const name of TABLE_FILES) await cut(name, cuts.tables[name]);
  await cut("recording.json", sizes["recording.json"] ? 0 : undefined);
  const keptS = lastTime(frames);
  if (keptS > 0) state.facts.seconds = keptS + WHOLE_FRAME_S;
}

/** @param {Walk} state */
function frameBytesOf({ kind, rateHz }) {
  if (kind === "baseband") return 4 * BASEBAND.frameSamples;
  return 2 * Math.round(WHOLE_FRAME_S * rateHz);
}

// Maps as a phone keeps them: whole, only what changed, and nothing that the server did not sign.

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { test } from "node:test";

import {
  forgetLink, keyIn, linkedMaps, pair, pinnedKey, rememberLink, trustAsGuest,
} from "../../../../src/elfslam/serve/pages/keeping/store.js";
import * as refusals from "../../../../src/elfslam/serve/pages/keeping/packages.js";
import { openPackages } from "../../../../src/elfslam/serve/pages/keeping/packages.js";
import { spotsOf, wholeOf } from "../../../../src/elfslam/serve/pages/keeping/tiles.js";
import { NO_ANSWER } from "../../../../src/elfslam/serve/pages/shared/api.js";

const FOLDER = process.env.ELFSLAM_PACKAGES;
const STATES = JSON.parse(readFileSync(`${FOLDER}/states.json`, "utf8"));
const MAP = STATES.map;
const FRAGMENT = `#token=abc&key=${STATES.key.key}`;

/** A server in one of its states; `changed` may alter what it answers, by the kind of the address. */
function serverIn(state, changed = {}) {
  const asked = [];
  const ask = async (path) => {
    asked.push(path);
    const [, , kind, map, , sha256] = path.split("/");
    if (kind === "key") return json((changed.key ?? same)(STATES.key));
    if (sha256 === undefined) return json((changed.signed ?? same)(map === MAP ? STATES[state] : STATES.other));
    const bytes = (changed.part ?? same)(readFileSync(`${FOLDER}/parts/${sha256}`), asked.length);
    return bytes instanceof Response ? bytes : new Response(bytes);
  };
  return { ask, asked, parts: () => asked.filter((path) => path.split("/").length === 6).length };
}

/** What the browser keeps, in memory. */
function memoryStore() {
  const kept = new Map();
  let last = Promise.resolve();
  return {
    read: async (key) => kept.get(key),
    names: async () => [...kept.keys()],
    write: async (key, value) => void kept.set(key, value),
    remove: async (keys) => keys.forEach((key) => kept.delete(key)),
    alone: (work) => (last = last.catch(() => {}).then(work)),
  };
}

const same = (value) => value;
const json = (value) => new Response(JSON.stringify(value));
const manifestOf = (state) => JSON.parse(STATES[state].manifest);

async function pairedStore() {
  const store = memoryStore();
  await pair(store, FRAGMENT, "zoe");
  return store;
}

/** A phone that holds a state of the map. */
async function holding(state) {
  const store = await pairedStore();
  await openPackages(store, serverIn(state).ask).update(MAP);
  return store;
}

function block({ walk, order, xyM, headingRad, covarianceM2, weight, vectors }) {
  const whole = [walk, order].map((column) => Float32Array.from(column));
  const parts = [...whole, xyM, headingRad, covarianceM2, weight, vectors];
  return Buffer.concat(parts.map((part) => Buffer.from(part.buffer, part.byteOffset, part.byteLength)));
}

async function assertHolds(store, state) {
  const packages = openPackages(store, serverIn(state).ask);
  const { floorMap, encoderBytes, facts } = await packages.open(MAP);
  assert.ok(block(floorMap).equals(readFileSync(`${FOLDER}/${state}.f32`)), "the map is Python's, bit for bit");
  const told = manifestOf(state);
  assert.ok(Buffer.from(encoderBytes).equals(readFileSync(`${FOLDER}/parts/${told.encoder.sha256}`)));
  assert.equal(floorMap.encoder, told.encoder.identity);
  assert.deepEqual(floorMap.parameters, told.parameters);
  assert.equal(facts.revision, told.revision);
  assert.equal(facts.spots, floorMap.headingRad.length);
  const [held] = await packages.list();
  assert.deepEqual([held.map, held.name, held.revision, held.spots], [MAP, "Hall", told.revision, facts.spots]);
}

test("a map arrives whole, and progress tells how much of it", async () => {
  const store = await pairedStore();
  const progress = [];
  const server = serverIn("first");
  const made = await openPackages(store, server.ask).update(MAP, (each) => progress.push(each));
  assert.equal(made.fetchedBytes, made.sizeBytes);
  assert.deepEqual(progress[0], { doneBytes: 0, totalBytes: made.sizeBytes });
  assert.deepEqual(progress.at(-1), { doneBytes: made.sizeBytes, totalBytes: made.sizeBytes });
  await assertHolds(store, "first");
});

test("only what changed is fetched, and what is not needed any more goes", async () => {
  const store = await holding("first");
  const again = serverIn("first");
  assert.equal((await openPackages(store, again.ask).update(MAP)).changed, false);
  assert.equal(again.parts(), 0);
  const server = serverIn("second");
  const made = await openPackages(store, server.ask).update(MAP);
  assert.deepEqual(manifestOf("second").features, manifestOf("first").features);
  const before = new Set(manifestOf("first").tiles.map((tile) => tile.sha256));
  const fresh = manifestOf("second").tiles.filter((tile) => !before.has(tile.sha256));
  assert.ok(fresh.length > 1 && fresh.length < 5, "a planted change touches a few of 16 tiles");
  assert.deepEqual([made.changed, made.fetchedParts, server.parts()], [true, fresh.length, fresh.length]);
  await assertHolds(store, "second");
  const names = (await store.names()).filter((name) => name.startsWith("part/"));
  assert.equal(names.length, made.parts);
});

test("maps share their tiles, and the one that stays keeps them", async () => {
  const store = await holding("second");
  const server = serverIn("second");
  const packages = openPackages(store, server.ask);
  await packages.update(STATES.otherMap);
  assert.equal(server.parts(), 0, "the other map has the same tiles and the same encoder");
  await packages.remove(STATES.otherMap);
  await assertHolds(store, "second");
  await packages.remove(MAP);
  assert.deepEqual(await store.names(), ["pairing"]);
  await assert.rejects(packages.open(MAP), { message: refusals.NOT_HERE });
});

const flipped = (bytes) => {
  const other = Buffer.from(bytes);
  other[other.length >> 1] ^= 1;
  return other;
};
const otherKey = async () => {
  const made = await crypto.subtle.generateKey({ name: "ECDSA", namedCurve: "P-256" }, true, ["sign", "verify"]);
  const spki = Buffer.from(await crypto.subtle.exportKey("spki", made.publicKey));
  const sign = async (manifest) => {
    const signing = { name: "ECDSA", hash: "SHA-256" };
    const bytes = await crypto.subtle.sign(signing, made.privateKey, Buffer.from(manifest));
    return { manifest, signature: Buffer.from(bytes).toString("base64") };
  };
  return { spki: spki.toString("base64"), sign };
};
const foreign = await otherKey();
const resigned = await foreign.sign(STATES.second.manifest);
const edited = (change) => ({ manifest, signature }) => {
  const told = JSON.parse(manifest);
  change(told);
  return { manifest: JSON.stringify(told), signature };
};

const TAMPERINGS = {
  "another key": [{ key: () => ({ spki: foreign.spki }), signed: () => resigned }, refusals.WRONG_KEY],
  "no key at all": [{ key: () => ({ spki: "AAAA" }) }, refusals.WRONG_KEY],
  "a signature by another key": [{ signed: () => resigned }, refusals.WRONG_SIGNATURE],
  "no signature": [{ signed: ({ manifest }) => ({ manifest, signature: "" }) }, refusals.WRONG_SIGNATURE],
  "a signature that is no base64": [{ signed: ({ manifest }) => ({ manifest, signature: "%" }) }, refusals.WRONG_SIGNATURE],
  "a space more": [{ signed: ({ manifest, signature }) => ({ manifest: `${manifest} `, signature }) }, refusals.WRONG_SIGNATURE],
  "a later revision": [{ signed: edited((told) => (told.revision += 1)) }, refusals.WRONG_SIGNATURE],
  "another encoder's digest": [{ signed: edited((told) => (told.encoder.sha256 = "0".repeat(64))) }, refusals.WRONG_SIGNATURE],
  "a tile left out": [{ signed: edited((told) => told.tiles.pop()) }, refusals.WRONG_SIGNATURE],
  "another parameter": [{ signed: edited((told) => (told.parameters.locate.unknown_below = -1)) }, refusals.WRONG_SIGNATURE],
  "another map": [{ signed: () => STATES.other }, refusals.OTHER_MAP],
  "a tile with one bit turned": [{ part: flipped }, refusals.WRONG_PART],
  "a tile cut off": [{ part: (bytes) => bytes.subarray(0, -1) }, refusals.WRONG_PART],
  "a tile with more behind it": [{ part: (bytes) => Buffer.concat([bytes, bytes]) }, refusals.WRONG_PART],
  "a part that is gone": [
    { part: () => new Response('{"detail":"gone"}', { status: 404 }) }, "gone",
  ],
};

for (const [what, [changed, line]] of Object.entries(TAMPERINGS)) {
  test(`refused, and what was held stays: ${what}`, async () => {
    const store = await holding("first");
    await assert.rejects(openPackages(store, serverIn("second", changed).ask).update(MAP), { message: line });
    assert.ok(!line.includes("\n"));
    await assertHolds(store, "first");
    await openPackages(store, serverIn("second").ask).update(MAP);
    await assertHolds(store, "second");
  });
}

test("refused from the first byte: a tampered encoder, and nothing is listed", async () => {
  const store = await pairedStore();
  const { size_bytes: size } = manifestOf("first").encoder;
  const part = (bytes) => (bytes.length === size ? flipped(bytes) : bytes);
  const packages = openPackages(store, serverIn("first", { part }).ask);
  await assert.rejects(packages.update(MAP), { message: refusals.WRONG_PART });
  assert.deepEqual(await packages.list(), []);
  await assert.rejects(packages.open(MAP), { message: refusals.NOT_HERE });
});

test("an older state is refused, and the newer one stays", async () => {
  const store = await holding("second");
  await assert.rejects(openPackages(store, serverIn("first").ask).update(MAP), { message: refusals.OLDER });
  await assertHolds(store, "second");
});

test("a phone that scanned no key takes nothing", async () => {
  const store = memoryStore();
  const packages = openPackages(store, serverIn("first").ask);
  await assert.rejects(packages.update(MAP), { message: refusals.NO_KEY });
  await pair(store, "#token=abc", "zoe");
  await assert.rejects(packages.update(MAP), { message: refusals.NO_KEY });
  await pair(store, "#token=abc&key=short", "zoe");
  await assert.rejects(packages.update(MAP), { message: refusals.NO_KEY });
});

test("an update that was cut off goes on where it was", async () => {
  const store = await pairedStore();
  let left = 6;
  const part = (bytes) => {
    left -= 1;
    if (left < 0) throw new TypeError("the network is gone");
    return bytes;
  };
  const broken = openPackages(store, serverIn("first", { part }).ask);
  await assert.rejects(broken.update(MAP), { message: NO_ANSWER });
  const server = serverIn("first");
  const made = await openPackages(store, server.ask).update(MAP);
  assert.equal(made.fetchedParts, made.parts - 6);
  await assertHolds(store, "first");
});

test("a server that asks for patience is waited for", async () => {
  const store = await pairedStore();
  let refused = 0;
  const part = (bytes, count) => {
    if (count % 7 !== 0 || refused > 1) return bytes;
    refused += 1;
    return new Response("{}", { status: 429, headers: { "Retry-After": "0.01" } });
  };
  await openPackages(store, serverIn("first", { part }).ask).update(MAP);
  assert.ok(refused > 0);
  await assertHolds(store, "first");
});

test("what the phone itself damaged is noticed, and fetched again", async () => {
  const store = await holding("first");
  const [name] = (await store.names()).filter((each) => each.startsWith("part/"));
  await store.write(name, flipped(await store.read(name)));
  const server = serverIn("first");
  const packages = openPackages(store, server.ask);
  await assert.rejects(packages.open(MAP), { message: refusals.DAMAGED });
  assert.equal((await packages.update(MAP)).fetchedParts, 1);
  await assertHolds(store, "first");
});

test("another person's maps are forgotten, one's own stay", async () => {
  const store = await holding("first");
  await pair(store, FRAGMENT, "zoe");
  await pair(store, "#token=new", "zoe");
  await assertHolds(store, "first");
  await pair(store, FRAGMENT, "ben");
  assert.deepEqual(await store.names(), ["pairing"]);
});

test("a guest trusts the key of the link, and keeps all when they are paired", async () => {
  const store = memoryStore();
  await trustAsGuest(store, FRAGMENT.replace("token", "link"));
  assert.equal(await pinnedKey(store), STATES.key.key);
  await openPackages(store, serverIn("first").ask).update(MAP);
  const linked = { map: MAP, name: "Hall", venue: null, floor: null, created_utc: "", owner: "Ada" };
  await rememberLink(store, linked);
  await pair(store, FRAGMENT, "zoe");
  await assertHolds(store, "first");
  assert.deepEqual(await linkedMaps(store), [linked]);
  await forgetLink(store, MAP);
  assert.deepEqual(await linkedMaps(store), []);
});

test("a link makes nobody trust another key", async () => {
  const store = await pairedStore();
  await trustAsGuest(store, `#link=x&key=${"A".repeat(43)}`);
  assert.equal(await pinnedKey(store), STATES.key.key);
  const older = memoryStore();
  await pair(older, "#token=abc", "zoe");
  await trustAsGuest(older, FRAGMENT);
  assert.equal(await pinnedKey(older), STATES.key.key, "none was known");
  await pair(older, "#token=abc", "ben");
  assert.equal(await pinnedKey(older), null);
});

test("the key of an address", () => {
  assert.equal(keyIn(FRAGMENT), STATES.key.key);
  assert.equal(keyIn("#token=abc"), null);
  assert.equal(keyIn("#token=abc&key=<script>"), null);
});

test("parts that are cut off or missing make no map; halves are read as they are", () => {
  const read = ({ sha256 }) => readFileSync(`${FOLDER}/parts/${sha256}`);
  const { tiles, features } = manifestOf("first");
  const stretches = features.map((part) => ({ walk: part.walk, bytes: read(part) }));
  const all = tiles.map(read);
  assert.equal(spotsOf(all, stretches).headingRad.length, 400);
  for (const size of [0, 3, 4, all[0].length - 1]) {
    assert.throws(() => spotsOf([all[0].subarray(0, size), ...all.slice(1)], stretches), RangeError);
  }
  assert.throws(() => spotsOf(all, stretches.slice(1)), RangeError);
  assert.throws(() => spotsOf(all, stretches.map((each) => ({ ...each, walk: 1 }))), RangeError);
  const halves = [[0x3c00, 1], [0xc000, -2], [0x0001, 2 ** -24], [0x7bff, 65504], [0x3555, 0.333251953125], [0x8000, -0]];
  for (const [half, number] of halves) assert.ok(Object.is(wholeOf(half), number));
  assert.ok(Number.isNaN(wholeOf(0x7e00)));
  assert.equal(wholeOf(0xfc00), -Infinity);
});

// Telling others where the walker is: two a second at most, never late, over when the walk is.

import assert from "node:assert/strict";
import { test } from "node:test";

import {
  fresh, newWalk, startPublishing, toldOf, withLatest,
} from "../../../../src/elfslam/serve/pages/phone/locating/position_publisher.js";

const fixAt = (tS, more = {}) => ({ tS, xyM: [1, 2], headingRad: 0.5, covarianceM2: [0.04, 0.01, 0.12], score: 1, status: "OK", ...more });
const times = (fixes) => fixes.map(({ tS }) => tS);
/** What has been promised is done. */
const settled = async () => {
  for (let turn = 0; turn < 10; turn += 1) await null;
};

test("of each half second the latest fix waits", () => {
  const waiting = [0.1, 0.3, 0.49, 0.5, 0.9, 1.2, 1.7].map((tS) => fixAt(tS)).reduce(withLatest, []);
  assert.deepEqual(times(waiting), [0.49, 0.9, 1.2, 1.7]);
});

test("what is older than five seconds is not sent", () => {
  assert.deepEqual(times(fresh([1, 4.9, 5, 9].map((tS) => fixAt(tS)), 10)), [5, 9]);
});

test("a fix is told with its age, and without what is not known", () => {
  assert.deepEqual(toldOf(fixAt(3), 4.5), { age_s: 1.5, status: "OK", x_m: 1, y_m: 2, heading_rad: 0.5, sigma_m: Math.sqrt(0.08) });
  assert.deepEqual(toldOf(fixAt(3, { headingRad: NaN, covarianceM2: null }), 2), { age_s: 0, status: "OK", x_m: 1, y_m: 2 });
  assert.deepEqual(toldOf(fixAt(3, { xyM: null, status: "UNKNOWN_PLACE" }), 3), { age_s: 0, status: "UNKNOWN_PLACE" });
});

test("every walk has a name of its own", () => {
  const names = new Set(Array.from({ length: 50 }, newWalk));
  assert.equal(names.size, 50);
  for (const name of names) assert.match(name, /^[0-9a-f]{16}$/);
});

/** A telling with a clock that is moved by hand, and a server that answers when it is told to. */
function telling(mock) {
  mock.timers.enable({ apis: ["setInterval"] });
  const world = { nowS: 0, sent: [], troubles: [], answers: [] };
  const told = startPublishing({
    map: "m",
    nowS: () => world.nowS,
    send: (message, more) => {
      world.sent.push({ ...message, keepalive: more.keepalive === true });
      return world.answers.length > 0 ? world.answers.shift() : Promise.resolve(null);
    },
    trouble: (error, isFinal) => world.troubles.push([error?.message ?? null, isFinal]),
  });
  const second = async () => {
    world.nowS += 1;
    mock.timers.tick(1000);
    await settled();
  };
  return { world, told, second };
}

test("once a second what has come goes out together, and nothing where nothing came", async (t) => {
  const { world, told, second } = telling(t.mock);
  await second();
  [1.1, 1.3, 1.8].forEach((tS) => told.fix(fixAt(tS)));
  await second();
  await second();
  assert.equal(world.sent.length, 1);
  assert.deepEqual(world.sent[0].positions.map(({ age_s }) => Math.round(age_s * 10) / 10), [0.7, 0.2]);
  assert.equal(world.sent[0].map, "m");
  assert.deepEqual(world.troubles, [[null, false]]);
  told.end();
});

test("while the server is slow fixes wait, but no longer than they are of use", async (t) => {
  const { world, told, second } = telling(t.mock);
  let answer = () => {};
  world.answers.push(new Promise((resolve) => { answer = resolve; }));
  told.fix(fixAt(0.5));
  await second();
  for (let k = 0; k < 9; k += 1) {
    told.fix(fixAt(world.nowS));
    await second();
  }
  assert.equal(world.sent.length, 1);
  answer(null);
  await settled();
  await second();
  assert.equal(world.sent.length, 2);
  assert.ok(world.sent[1].positions.length <= 6);
  assert.ok(world.sent[1].positions.every(({ age_s }) => age_s <= 5));
  told.end();
});

test("a lost message is not sent again, and it is said whether asking again is of use", async (t) => {
  const { world, told, second } = telling(t.mock);
  world.answers.push(Promise.reject(Object.assign(new Error("away"), { status: 0 })));
  world.answers.push(Promise.reject(Object.assign(new Error("off"), { status: 409 })));
  for (const tS of [0.5, 1.5, 2.5]) {
    told.fix(fixAt(tS));
    await second();
  }
  assert.deepEqual(world.troubles, [["away", false], ["off", true], [null, false]]);
  assert.deepEqual(world.sent.map(({ positions }) => positions.length), [1, 1, 1]);
  told.end();
});

test("at the end the server is told, also by a page that closes, and nothing follows", async (t) => {
  const { world, told, second } = telling(t.mock);
  told.fix(fixAt(0.5));
  told.end();
  await second();
  assert.equal(world.sent.length, 1);
  const [{ is_over: isOver, positions, keepalive }] = world.sent;
  assert.deepEqual([isOver, positions, keepalive], [true, [], true]);
  assert.deepEqual(world.troubles, []);
});

// Lists of the desk: what is found, in which order, in which groups, and what is chosen.

import assert from "node:assert/strict";
import { test } from "node:test";

import { venueOf } from "../../../src/elfslam/serve/pages/desk/maps_view.js";
import {
  chosenOf,
  firstOrder,
  forgetGone,
  mapChange,
  matching,
  sorted,
  SORTS,
} from "../../../src/elfslam/serve/pages/desk/lists.js";
import { sharedWords } from "../../../src/elfslam/serve/pages/desk/sharing.js";
import { linkIn } from "../../../src/elfslam/serve/pages/shared/api.js";
import { byName, grouped, placeOf } from "../../../src/elfslam/serve/pages/shared/places.js";

const THINGS = [
  { id: "a", name: "Café", created_utc: "2026-01-02", length: 5 },
  { id: "b", name: "Hall 10", created_utc: "2026-01-03", length: null },
  { id: "c", name: "hall 9", created_utc: "2026-01-01", length: 70 },
];
const ids = (things) => things.map(({ id }) => id).join("");

test("every word of a search has to stand somewhere, whatever its case and accents", () => {
  const found = (find) => ids(matching(THINGS, find, ({ name, id }) => [name, id === "a" ? "First Floor" : null]));
  assert.equal(found(""), "abc");
  assert.equal(found("  "), "abc");
  assert.equal(found("HALL"), "bc");
  assert.equal(found("cafe"), "a");
  assert.equal(found("café"), "a");
  assert.equal(found("floor cafe"), "a");
  assert.equal(found("hall cafe"), "");
  assert.equal(found("null"), "");
});

test("lists are sorted by age, by name with its numbers, and by length", () => {
  const by = (sort) => ids(sorted(THINGS, sort, ({ length }) => length));
  assert.equal(firstOrder().by, "newest");
  assert.deepEqual(Object.keys(SORTS).map(by), ["bac", "cab", "acb", "cab"]);
  assert.equal(ids(THINGS), "abc", "the list itself stays as it was");
});

test("what nobody sees is not acted on, and what is gone is not chosen", () => {
  const chosen = new Set(["a", "c", "x"]);
  assert.equal(ids(chosenOf(THINGS.slice(1), chosen)), "c");
  forgetGone(chosen, THINGS);
  assert.deepEqual([...chosen], ["a", "c"]);
});

test("maps are grouped by venue, and floors stand from below", () => {
  const map = (id, venue, floor, level) => ({ id, venue, floor, level });
  const maps = [
    map("1", null, null, null), map("2", "North Mall", "Floor 10", 10), map("3", "Annex 2", null, null), map("4", "North Mall", "Ground floor", 0),
    map("5", "North Mall", "Floor 2", 2), map("6", "North Mall", null, null), map("7", "North Mall", "Mezzanine", null), map("8", "Annex 10", "Floor 1", 1),
    map("9", "North Mall", "Floor 2", 2), map("0", "North Mall", "Basement", -1),
  ];
  assert.deepEqual(grouped(maps).map(({ things }) => ids(things)), ["3", "8", "0", "4", "59", "2", "7", "6", "1"]);
  assert.deepEqual(grouped(maps)[4], { venue: "North Mall", floor: "Floor 2", things: [maps[4], maps[8]] });
  assert.deepEqual(grouped([]), []);
  assert.deepEqual(grouped([{ id: "a" }]).map(({ venue }) => venue), [null]);
  assert.equal(placeOf({ venue: "Mall", floor: "Floor 2" }), "Mall · Floor 2");
  assert.equal(placeOf({ venue: "Mall", floor: null }), "Mall");
  assert.equal(placeOf({}), "");
  assert.ok(byName("hall 9", "Hall 10") < 0);
});

test("a list says with whom a map is shared, and what one may do with another's", () => {
  const words = (right, shared_with, has_link) => sharedWords({ right, shared_with, has_link });
  assert.equal(words("own", 0, false), "");
  assert.equal(words("own", 1, false), "shared with 1 person");
  assert.equal(words("own", 0, true), "shared with everyone with the link");
  assert.equal(words("own", 2, true), "shared with 2 people and everyone with the link");
  assert.equal(words("read", 0, false), "you can view it");
  assert.equal(words("edit", 0, false), "you can edit it");
});

test("a field that was emptied means nowhere", () => {
  assert.deepEqual(mapChange("Hall", "", ""), { name: "Hall", venue: null, floor: null });
  assert.deepEqual(mapChange("Hall", "Mall", "1"), { name: "Hall", venue: "Mall", floor: "1" });
});

test("an export is filled in with what the map knows of its venue", () => {
  assert.deepEqual(venueOf({ venue: "Mall", floor: "Ground floor", level: 0 }), { name: "Mall", level: "Ground floor", ordinal: "0" });
  assert.deepEqual(venueOf({ venue: null, floor: null, level: null }), {});
  assert.deepEqual(venueOf({}), {});
});

test("the link in an address", () => {
  assert.equal(linkIn("#link=abc.d-_e&key=f"), "abc.d-_e");
  assert.equal(linkIn("#/maps/link=a"), null);
  assert.equal(linkIn("#token=abc"), null);
  assert.equal(linkIn(""), null);
});

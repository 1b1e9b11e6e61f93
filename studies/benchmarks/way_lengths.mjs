/** The phone's ways along walked ground: `node way_lengths.mjs GIVEN.json` prints a way for each pair, or null. */

import { readFileSync } from "node:fs";

import { pointAlong, walkedGroundOf, wayFrom, waysTo } from "../../src/elfslam/serve/pages/phone/locating/walked_ground.js";

const { spots, pairs, ahead } = JSON.parse(readFileSync(process.argv[2], "utf-8"));
const ground = walkedGroundOf(spots);
const ways = pairs.map(([from, goal]) => {
  const way = wayFrom(waysTo(ground, goal), from);
  return way && { length_m: way.length_m, ahead: pointAlong(way.line, ahead) };
});
process.stdout.write(JSON.stringify(ways));

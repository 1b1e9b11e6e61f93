// Prints, as JSON, what the scripts named on the command line give to the catalogues: their keys, and what looks like
// words for people and is no key.

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";

const [tools, ...files] = process.argv.slice(2);
const { parse } = createRequire(tools)("espree");

/** What takes a text, and which of its arguments those are. */
const TAKING = { t: [0], woven: [0], marked: [0], counted: [1, 2] };
/** Whose arguments nobody but who develops reads. */
const UNREAD = ["warn", "error", "log"];
const SENTENCE = /^\P{L}*\p{Lu}\p{Ll}+(?![\p{L}\d_-])|\p{Ll}{2,},? \p{Ll}{2,}/u;

/** What is written there, or null where it is computed. */
function written(node) {
  if (node?.type === "Literal" && typeof node.value === "string") return node.value;
  if (node?.type !== "BinaryExpression" || node.operator !== "+") return null;
  const [left, right] = [written(node.left), written(node.right)];
  return left === null || right === null ? null : left + right;
}

function look(node, found) {
  if (node === null || typeof node !== "object") return;
  if (Array.isArray(node)) return node.forEach((each) => look(each, found));
  if (/^(Import|ExportAll)/.test(node.type) || (node.type === "ExportNamedDeclaration" && node.source)) return;
  if (node.type === "Property" && /^class(Name)?$/.test(node.key.name)) return;
  if (node.type === "CallExpression") {
    const { name = node.callee.property?.name } = node.callee;
    if (UNREAD.includes(name)) return;
    if (node.callee.type === "Identifier" && Object.hasOwn(TAKING, name)) return take(node, TAKING[name], found);
  }
  if (node.type === "Literal" && typeof node.value === "string" && SENTENCE.test(node.value)) found.bare.push(node.value);
  if (node.type === "TemplateLiteral") {
    const text = node.quasis.map(({ value }) => value.cooked).join("…");
    if (SENTENCE.test(text)) found.bare.push(text);
  }
  for (const [name, child] of Object.entries(node)) if (name !== "loc") look(child, found);
}

/** Behind a key, where one English text is two in other languages. */
function contextOf(values) {
  const given = values?.properties?.find(({ key }) => key?.name === "context");
  return given ? `_${given.value.value}` : "";
}

function take(node, places, found) {
  const texts = places.map((place) => written(node.arguments[place]));
  if (texts.includes(null)) found.computed.push(node.start);
  else if (places.length === 1) found.keys.push(texts[0] + contextOf(node.arguments[1]));
  else found.counted.push(texts);
  node.arguments.forEach((argument, at) => places.includes(at) || look(argument, found));
}

const told = {};
for (const file of files) {
  const found = { keys: [], counted: [], bare: [], computed: [] };
  look(parse(readFileSync(file, "utf8"), { ecmaVersion: "latest", sourceType: "module" }), found);
  told[file] = found;
}
process.stdout.write(JSON.stringify(told));

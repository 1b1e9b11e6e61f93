// Type-checks the pages. Files named in untyped.txt are not held to it yet: the list only shrinks.
import { spawnSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { dirname, join, relative, resolve } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const pages = resolve(here, "../../src/elfslam/serve/pages");
const untyped = new Set(readFileSync(join(here, "untyped.txt"), "utf8").split("\n").filter(Boolean));

const compiler = join(here, "node_modules", ".bin", "tsc");
const { stdout, error } = spawnSync(compiler, ["--project", here, "--pretty", "false"], { encoding: "utf8", cwd: here });
if (error) throw error;

const found = stdout.split("\n").filter((line) => line.includes("error TS"));
const fileOf = (line) => relative(pages, resolve(here, line.slice(0, line.indexOf("("))));
const wrong = found.filter((line) => !untyped.has(fileOf(line)));
const files = new Set(found.map(fileOf));
const mended = [...untyped].filter((file) => !files.has(file));

for (const line of wrong) console.error(line);
for (const file of mended) console.error(`${file}: has no error any more; strike it off untyped.txt`);
if (wrong.length || mended.length) process.exit(1);

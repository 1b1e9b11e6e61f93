// Type-checks the pages by the types that their comments tell.
import { spawnSync } from "node:child_process";
import { dirname, join } from "node:path";
import { fileURLToPath } from "node:url";

const here = dirname(fileURLToPath(import.meta.url));
const compiler = join(here, "node_modules", ".bin", "tsc");
const { status, error } = spawnSync(compiler, ["--project", here, "--pretty", "false"], { stdio: "inherit" });
if (error) throw error;
process.exit(status ?? 1);

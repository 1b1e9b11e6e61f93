"""Fails where base, stages and slam are covered by less than 95 % of branches and lines."""

import json
import sys
from pathlib import Path

LEAST_PERCENT = 95.0
CORE = ("elfslam/base/", "elfslam/stages/", "elfslam/slam/")


def core_coverage(report: dict) -> float:
    """Percent of statements and branches that their own tests reach, of these rooms."""
    reached = possible = 0
    for name, entry in report["files"].items():
        if any(part in name.replace("\\", "/") for part in CORE):
            summary = entry["summary"]
            reached += summary["covered_lines"] + summary["covered_branches"]
            possible += summary["num_statements"] + summary["num_branches"]
    return 100.0 * reached / possible


def main() -> int:
    percent = core_coverage(json.loads(Path(sys.argv[1]).read_text()))
    print(f"base, stages, slam: {percent:.1f} % of lines and branches (wanted {LEAST_PERCENT:g} %)")
    return 0 if percent >= LEAST_PERCENT else 1


if __name__ == "__main__":
    raise SystemExit(main())

"""What Lighthouse says of every page: performance on a slow phone, accessibility, best practices.

Usage, from the root of the project, once Lighthouse is there:

    npm install --global lighthouse@12.8.2
    python -m studies.benchmarks.lighthouse

A real server with the demonstration building. Scores go to 100; what costs points stands below.
"""

import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from elfslam.app.console import print_rows, say
from studies.benchmarks.browser_walk import CHROMIUM
from studies.benchmarks.served import owner_of, serving

LIGHTHOUSE = os.environ.get("LIGHTHOUSE") or shutil.which("lighthouse") or ""
CATEGORIES = ("performance", "accessibility", "best-practices")
FULL = 0.995


def report_of(url: str, bearer: str, folder: Path) -> dict[str, Any]:
    """What Lighthouse found on a page. Raises CalledProcessError where it cannot look."""
    told, out = json.dumps({"Authorization": bearer}), folder / "report.json"
    options = [f"--only-categories={','.join(CATEGORIES)}", f"--extra-headers={told}", "--quiet",
               "--chrome-flags=--headless=new --no-sandbox", "--output=json",
               f"--output-path={out}"]  # fmt: skip
    subprocess.run([LIGHTHOUSE, url, *options], env={**os.environ, "CHROME_PATH": CHROMIUM},
                   check=True)  # fmt: skip
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    return found


def costly(report: dict[str, Any], category: str) -> list[str]:
    """Titles of what is not right in a category and counts."""
    audits = [(report["audits"][each["id"]], each["weight"])
              for each in report["categories"][category]["auditRefs"]]  # fmt: skip
    return [audit["title"] for audit, weight in audits
            if weight > 0 and audit["score"] is not None and audit["score"] < FULL]  # fmt: skip


def main() -> None:
    """Look at each page, and print scores and what costs points."""
    if not (LIGHTHOUSE and CHROMIUM):
        sys.exit("install first: chromium; npm install --global lighthouse@12.8.2")
    rows, wrong = [], []
    with tempfile.TemporaryDirectory() as name, serving(Path(name) / "data") as address:
        with owner_of(address) as owner:
            owner.post("/api/demonstration").raise_for_status()
            first = owner.get("/api/maps").raise_for_status().json()[0]["id"]
            url, bearer = str(owner.base_url).rstrip("/"), owner.headers["Authorization"]
        pages = {"phone": "/", "desk, recordings": "/desk.html#/recordings",
                 "desk, maps": "/desk.html#/maps", "desk, a map": f"/desk.html#/maps/{first}",
                 "desk, people": "/desk.html#/people", "trust": "/trust"}  # fmt: skip
        for page, path in pages.items():
            say(page)
            report = report_of(url + path, bearer, Path(name))
            scores = {each: round(100 * report["categories"][each]["score"]) for each in CATEGORIES}
            rows.append({"page": page, **scores})
            wrong += [f"{page}: {title}" for each in CATEGORIES for title in costly(report, each)]
    print_rows(rows, title="Lighthouse, a slow phone", as_json=False)
    print("\n".join(wrong))


if __name__ == "__main__":
    main()

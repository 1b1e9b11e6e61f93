"""How soon the phone page can be used on a slow phone in a slow network, and again without any.

Usage, from the root of the project:

    python -m studies.benchmarks.slow_phone [--visits 5]

A real server and Chromium, whose processor is slowed fourfold and whose network has the delay and
rate of 3G as Lighthouse has it. Prints for each visit when something is first painted, and when all
scripts have run, so that a tap does something; for the first visit, a second one, and one without
a network. Seconds.
"""

import argparse
import tempfile
from pathlib import Path
from statistics import median
from typing import Any

from playwright.sync_api import Browser, sync_playwright

from elfslam.app.console import print_rows, say
from studies.benchmarks.browser_walk import CHROMIUM
from studies.benchmarks.served import serving

SLOWER = 4
DELAY_MS, RATE_BPS = 150, 1_600_000
THREE_G = {
    "offline": False,
    "latency": DELAY_MS,
    "downloadThroughput": RATE_BPS / 8,
    "uploadThroughput": RATE_BPS / 16,
}
KEPT = "html[data-offline=kept]"
PATIENCE_MS = 120_000
TOLD = """() => {
  const [visit] = performance.getEntriesByType("navigation");
  const [painted] = performance.getEntriesByName("first-contentful-paint");
  return {
    painted: (painted?.startTime ?? NaN) / 1000, usable: visit.domContentLoadedEventEnd / 1000,
    requests: performance.getEntriesByType("resource").length,
  };
}"""
"""The page's modules have run when DOMContentLoaded ends."""

Row = dict[str, object]


def main() -> None:
    """Visit the page as often as asked, each time in a browser that knows nothing of it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--visits", type=int, default=5)
    visits: int = parser.parse_args().visits
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder) / "data") as address,
        sync_playwright() as play,
    ):
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        rows = [row for number in range(visits) for row in visited(browser, address, number)]
        browser.close()
    print_rows(rows, title="The phone page on a slow phone (s)", as_json=False)
    for kind in ("first", "again", "offline"):
        usable = [float(str(row["usable"])) for row in rows if row["visit"] == kind]
        say(f"{kind}: usable after {median(usable):.2f} s (median of {visits})")


def visited(browser: Browser, address: str, number: int) -> list[Row]:
    """A first visit, another one, and one without a network."""
    context = browser.new_context(viewport={"width": 390, "height": 844})
    page = context.new_page()
    session = context.new_cdp_session(page)
    session.send("Emulation.setCPUThrottlingRate", {"rate": SLOWER})
    session.send("Network.enable")
    session.send("Network.emulateNetworkConditions", THREE_G)
    page.goto(address, timeout=PATIENCE_MS)
    rows = [row_of(page, number, "first")]
    page.wait_for_selector(KEPT, state="attached", timeout=PATIENCE_MS)
    page.reload(timeout=PATIENCE_MS)
    rows.append(row_of(page, number, "again"))
    context.set_offline(True)
    page.reload(timeout=PATIENCE_MS)
    rows.append(row_of(page, number, "offline"))
    context.close()
    return rows


def row_of(page: Any, number: int, kind: str) -> Row:
    """What the browser says of the visit that has just ended."""
    told = {name: round(float(value), 2) for name, value in page.evaluate(TOLD).items()}
    return {"try": number, "visit": kind, **told}


if __name__ == "__main__":
    main()

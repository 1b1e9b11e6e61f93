"""The line's modules run by a real browser, for the benchmarks that measure the page.

Workers of `page_stages/` run in a page of the server's own origin and under its headers; what they
are given are files of a folder.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, Route, sync_playwright

from elfslam.base.arrays import F32, F64
from elfslam.base.parameters import as_dict
from elfslam.base.values import FloorMap
from elfslam.serve.people.guards import CONTENT_POLICY
from elfslam.slam.parameters import Parameters

HERE = Path(__file__).parent / "page_stages"
CHROMIUM = shutil.which("chromium")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
PATIENCE_MS = 600_000
TYPES = {".html": "text/html", ".js": "text/javascript"}


@contextmanager
def browsing() -> Iterator[Browser]:
    """Chromium without a window."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=list(ARGUMENTS))
        yield browser
        browser.close()


def run_in_page(browser: Browser, address: str, worker: str, given: Path) -> tuple[Any, float]:
    """What a worker of `page_stages/` says with the files of the folder `given`.

    And the processor seconds that the page took.
    """
    context = browser.new_context()
    context.route("**/benchmarks/**", lambda route: _answer(route, given))
    page, before_s = context.new_page(), processor_s(browser)
    page.goto(f"{address.split('#', maxsplit=1)[0].rstrip('/')}/benchmarks/page.html#{worker}")
    page.wait_for_selector("#result:not(:empty)", timeout=PATIENCE_MS)
    said, spent_s = json.loads(page.inner_text("#result")), processor_s(browser) - before_s
    context.close()
    if "failed" in said:
        raise RuntimeError(said["failed"])
    return said, spent_s


def processor_s(browser: Browser) -> float:
    """Processor seconds of all pages so far."""
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    return float(sum(each["cpuTime"] for each in processes if each["type"] == "renderer"))


def _answer(route: Route, given: Path) -> None:
    path = route.request.url.partition("/benchmarks/")[2].partition("#")[0]
    inside = path.removeprefix("data/")
    file = given / inside if inside != path else HERE / path
    kind = TYPES.get(file.suffix, "application/octet-stream")
    headers = {"Content-Type": kind, "Content-Security-Policy": CONTENT_POLICY}
    route.fulfill(body=file.read_bytes(), headers=headers)


def write_floor_map(folder: Path, floor_map: FloorMap, parameters: Parameters) -> None:
    """A map as `given.js` reads it."""
    folder.mkdir(parents=True, exist_ok=True)
    elf = next(item for item in floor_map.payloads if item.kind == "elf")
    told = {"encoder": elf.encoder, "parameters": as_dict(parameters)}
    (folder / "map.json").write_text(json.dumps(told))
    write_f32(folder / "xy.f32", floor_map.xy_m)
    write_f32(folder / "heading.f32", floor_map.heading_rad)
    covariance = floor_map.covariance_m2[:, [0, 0, 1], [0, 1, 1]]
    write_f32(folder / "covariance.f32", covariance)
    write_f32(folder / "vectors.f32", elf.vectors)


def write_f32(file: Path, values: F32 | F64) -> None:
    """An array as little-endian float32."""
    file.parent.mkdir(parents=True, exist_ok=True)
    np.asarray(values, "<f4").tofile(file)

"""Located live in the page, by a real browser in a simulated room, with the server stopped.

A browser opens the phone page, gets the map, and is closed; the server is stopped. The browser is
started again on what it has kept, and another walker carries it through the room of
acoustic_loop.py.
"""

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import BrowserContext, Page, sync_playwright

from elfslam.base.values import Fixes, Truth
from elfslam.data.position_files import read_fixes
from studies.benchmarks.acoustic_loop import in_time, pulse_audio, room_between
from studies.benchmarks.browser_walk import (
    ARGUMENTS,
    CHROMIUM,
    PAUSE_S,
    PERMISSIONS,
    Course,
    MotionSensors,
)

SETTLING_S = 1.5
"""From the last step until the page has told all that it knows."""


@dataclass(frozen=True)
class Placed:
    """A walk that was located in the page: times count from its first chirp."""

    fixes: Fixes
    heard_share: float
    """Of the chirps."""
    requests: list[str]
    """What the network was asked for meanwhile."""


@dataclass(frozen=True)
class Errors:
    """Of fixes against the truth, both in the map's frame."""

    median_m: float
    quartile3_m: float
    within: float
    """Share of the fixes that lay no further off than the page said, where it says two of three."""


def walk_once(course: Course, address: str, folder: Path, seed: int) -> Placed:
    """One walk by a browser that was just started."""
    scratch = folder / "sound"
    scratch.mkdir(exist_ok=True)
    with (
        in_time(),
        pulse_audio(scratch) as environment,
        room_between(environment, course.responses, scratch, seed) as room,
        kept_browser(folder / "profile", environment) as context,
    ):
        return locate_walk(open_page(context, address), course, room, folder / "fixes.csv")


@contextmanager
def kept_browser(profile: Path, environment: dict[str, str] | None = None) -> Iterator[Any]:
    """A browser that keeps what it keeps in a folder, as a phone's does."""
    with sync_playwright() as play:
        context = play.chromium.launch_persistent_context(
            str(profile), executable_path=CHROMIUM, args=list(ARGUMENTS),
            ignore_default_args=["--mute-audio"], env={**(environment or os.environ)},
            permissions=list(PERMISSIONS), viewport={"width": 390, "height": 844},
            reduced_motion="reduce", accept_downloads=True,
        )  # fmt: skip
        yield context
        context.close()


def open_page(context: BrowserContext, address: str) -> Page:
    """The phone page."""
    page = context.pages[0] if context.pages else context.new_page()
    page.on("pageerror", lambda error: print("page:", error, flush=True))
    page.goto(address)
    return page


def get_map(profile: Path, address: str) -> None:
    """Pair, take the map onto the phone, and leave it there."""
    with kept_browser(profile) as context:
        page = open_page(context, address)
        page.click("#where")
        page.click("text=Get this map")
        page.wait_for_selector("text=Find me here", timeout=120_000)
        page.locator("html[data-offline=kept]").wait_for(timeout=120_000)


def locate_walk(page: Page, course: Course, room: Any, table: Path) -> Placed:
    """Located step by step from its first chirp to its last step."""
    sensors = MotionSensors(page)
    sensors.read(course.imu, 0.0)
    page.click("#where")
    page.click("text=Find me here")
    page.wait_for_selector("#place-stop:visible", timeout=30_000)
    page.click("#place-stop")
    page.click("label:has(input[value=track])")
    time.sleep(PAUSE_S + 0.5)
    requests: list[Any] = []

    def note(request: Any) -> None:
        requests.append(request)

    page.context.on("request", note)
    room.go()
    page.click("#place-start")
    begun_s = room.begun_s()
    while (now_s := time.monotonic() - begun_s) < course.duration_s + SETTLING_S:
        sensors.read(course.imu, min(now_s, course.duration_s))
    asked = [request.url for request in requests if not is_own(request)]
    heard = page.inner_text("#place-heard").rstrip("\u00a0 %")
    page.click("#place-stop")
    with page.expect_download() as download:
        page.click("#place-save")
    download.value.save_as(table)
    return Placed(read_fixes(table), int(heard) / 100 if heard.isdigit() else 0.0, asked)


def is_own(request: Any) -> bool:
    """Whether the phone answered it from what it keeps."""
    if request.url.startswith("blob:"):
        return True
    response = None if request.failure else request.response()
    return response is not None and bool(response.from_service_worker)


def errors_of(fixes: Fixes, truth: Truth, world_in_map: tuple[float, float, float]) -> Errors:
    """Errors of fixes whose times are those of the truth."""
    x_m, y_m, heading_rad = world_in_map
    true = truth_at(truth, fixes.t_s) @ [1, 1j] * np.exp(1j * heading_rad) + complex(x_m, y_m)
    given = np.isfinite(fixes.xy_m[:, 0])
    error_m = np.abs(fixes.xy_m[given] @ [1, 1j] - true[given])
    sigma_m = np.sqrt(np.trace(fixes.covariance_m2[given], axis1=1, axis2=2) / 2)
    within = float(np.mean(error_m <= sigma_m * np.sqrt(-2 * np.log(1 / 3))))
    return Errors(float(np.median(error_m)), float(np.quantile(error_m, 0.75)), within)


def world_in_map_of(walk: dict[str, Any], truth: Truth) -> tuple[float, float, float]:
    """The pose of the world in the map: the best rigid fit of true places to mapped ones."""
    mapped, true = np.array(walk["xy_m"]), truth_at(truth, walk["t_s"])
    middle_map, middle_true = mapped.mean(axis=0), true.mean(axis=0)
    one, other = (true - middle_true) @ [1, 1j], (mapped - middle_map) @ [1, 1j]
    heading_rad = float(np.angle(np.vdot(one, other)))
    corner = middle_map @ [1, 1j] - (middle_true @ [1, 1j]) * np.exp(1j * heading_rad)
    return float(corner.real), float(corner.imag), heading_rad


def truth_at(truth: Truth, t_s: Any) -> np.ndarray:
    """True places (n, 2) at some times."""
    columns = [np.interp(t_s, truth.t_s, truth.world_from_body[:, axis]) for axis in (0, 1)]
    return np.column_stack(columns)

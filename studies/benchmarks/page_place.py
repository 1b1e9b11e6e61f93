"""Located live in the page, by a real browser in a simulated room, with the server stopped.

    python -m studies.benchmarks.page_place \\
        [WORLD] [--seed N] [--map-seed M] [--rounds N] [--keep FOLDER]

A walk is simulated, sent and mapped by a server of its own. A browser opens the phone page, gets
the map, and is closed; the server is stopped. The browser is started again on what it has kept, and
another walker carries it through the room of acoustic_loop.py, twice: located step by step, and by
echoes alone. Printed is the error against the truth beside that of Python on the same walk, the
fixes in a minute, and what was asked of the network meanwhile.
Needs chromium, pulseaudio and the `test` extra.
"""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
import tempfile
import time
import tomllib
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from PIL import Image, ImageDraw
from playwright.sync_api import BrowserContext, Page, sync_playwright

from elfslam.base.arrays import F64
from elfslam.base.values import Fixes, FixStatus, Truth
from elfslam.data.position_files import read_fixes
from elfslam.data.recordings import write_recording
from elfslam.stages.chirp import describe_chirp
from elfslam.world import worlds
from elfslam.world.simulate import simulate
from elfslam.world.world_file import load_world
from studies.benchmarks.acoustic_loop import in_time, missing_programs, pulse_audio, room_between
from studies.benchmarks.browser_walk import (
    ARGUMENTS,
    CHROMIUM,
    PAUSE_S,
    PERMISSIONS,
    Course,
    MotionSensors,
    elfslam,
    plan_course,
    simulated_twin,
)
from studies.benchmarks.served import PIECE, metadata, owner_of, serving

MAP = "Mapped walk"
PIXELS_PER_M = 80
LONGEST_S = 1200
MODES = {"tracking": "track", "one-shot": "one-shot"}
SETTLING_S = 1.5
"""From the last step until the page has told all that it knows."""


@dataclass(frozen=True)
class Placed:
    """A walk that was located in the page; times count from its first chirp."""

    fixes: Fixes
    duration_s: float
    ready_s: float
    """From the tap until the page listens."""
    heard_share: float
    """Of the chirps."""
    requests: list[str]
    """What the network was asked for meanwhile."""

    @property
    def fixes_per_minute(self) -> float:
        """Those with a place."""
        return 60 * float(np.isfinite(self.fixes.xy_m[:, 0]).sum()) / self.duration_s


@dataclass(frozen=True)
class Errors:
    """Of fixes against the truth, both in the map's frame."""

    median_m: float
    quartile3_m: float
    largest_m: float
    within: float
    """Share of the fixes that lay no further off than the page said, where it says two of three."""
    counts: dict[str, int]


def make_map(address: str, world: str, seed: int, rounds: int, name: str = MAP) -> tuple[str, Any]:
    """Simulate a walk, send it, have it mapped; gives the map's id and the world's pose in it."""
    with owner_of(address) as client:
        truth = upload_walk(client, name, seed, rounds, world)
        wait_for_jobs(client)
        made = next(each for each in client.get("/api/maps").json() if each["name"] == name)
        walks = client.get(f"/api/maps/{made['id']}/view").json()["walks"]
        put_plan(client, made["id"], {name: truth}, world)
        return str(made["id"]), world_in_map_of(walks, {name: truth})


def fetch_map(address: str, map_id: str, folder: Path) -> Path:
    """The map's folder, as Python locates in it."""
    with owner_of(address) as client:
        content = client.get(f"/api/maps/{map_id}/map.zip")
    zipfile.ZipFile(io.BytesIO(content.raise_for_status().content)).extractall(folder)
    return next(folder.rglob("trajectory.tum")).parent


@contextmanager
def kept_browser(profile: Path, environment: dict[str, str] | None = None) -> Iterator[Any]:
    """A browser that keeps what it keeps in a folder, as a phone's does."""
    with sync_playwright() as play:
        context = play.chromium.launch_persistent_context(
            str(profile),
            executable_path=CHROMIUM,
            args=list(ARGUMENTS),
            ignore_default_args=["--mute-audio"],
            env={**(environment or os.environ)},
            permissions=list(PERMISSIONS),
            viewport={"width": 390, "height": 844},
            reduced_motion="reduce",
            accept_downloads=True,
        )
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


def locate_walk(page: Page, course: Course, room: Any, mode: str, folder: Path) -> Placed:
    """Located from its first chirp to its last step."""
    sensors = MotionSensors(page)
    sensors.read(course.imu, 0.0)
    page.click("#where")
    page.click("text=Find me here")
    page.wait_for_selector("#place-stop:visible", timeout=30_000)
    page.click("#place-stop")
    page.click(f"label:has(input[value={mode}])")
    time.sleep(PAUSE_S + 0.5)
    requests: list[Any] = []

    def note(request: Any) -> None:
        requests.append(request)

    page.context.on("request", note)
    room.go()
    tapped_s = time.monotonic()
    page.click("#place-start")
    begun_s = room.begun_s()
    until = begun_s + course.duration_s
    while (now := time.monotonic()) < until:
        sensors.read(course.imu, now - begun_s)
    still(sensors, course, SETTLING_S)
    asked = [request.url for request in requests if not is_own(request)]
    heard = page.inner_text("#place-heard").rstrip("\u00a0 %")
    page.screenshot(path=folder / f"{mode}.png")
    page.click("#place-stop")
    with page.expect_download() as download:
        page.click("#place-save")
    table = folder / f"{mode}.csv"
    download.value.save_as(table)
    heard_share = int(heard) / 100 if heard.isdigit() else 0.0
    ready_s = begun_s - tapped_s
    return Placed(read_fixes(table), course.duration_s, ready_s, heard_share, asked)


def is_own(request: Any) -> bool:
    """Whether the phone answered it from what it keeps."""
    if request.url.startswith("blob:"):
        return True
    response = None if request.failure else request.response()
    return response is not None and bool(response.from_service_worker)


def still(sensors: MotionSensors, course: Course, seconds: float) -> None:
    """Stand at the end of the walk."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        sensors.read(course.imu, course.duration_s)


def errors_of(fixes: Fixes, truth: Truth, world_in_map: Any) -> Errors:
    """Errors of fixes whose times are those of the truth."""
    x_m, y_m, heading_rad = world_in_map
    true = truth_at(truth, list(fixes.t_s)) @ [1, 1j] * np.exp(1j * heading_rad)
    true = true + complex(x_m, y_m)
    given = np.isfinite(fixes.xy_m[:, 0])
    error_m = np.abs(fixes.xy_m[given] @ [1, 1j] - true[given])
    sigma_m = np.sqrt(np.trace(fixes.covariance_m2[given], axis1=1, axis2=2) / 2)
    counts = {each.name: int((fixes.status == each).sum()) for each in FixStatus}
    if not given.any():
        return Errors(np.nan, np.nan, np.nan, np.nan, counts)
    within = float(np.mean(error_m <= sigma_m * np.sqrt(-2 * np.log(1 / 3))))
    return Errors(
        float(np.median(error_m)),
        float(np.quantile(error_m, 0.75)),
        float(error_m.max()),
        within,
        {name: count for name, count in counts.items() if count},
    )


def told(name: str, errors: Errors) -> str:
    """One line."""
    counts = ", ".join(f"{count} {status}" for status, count in errors.counts.items())
    return (
        f"{name}: median {errors.median_m:.2f} m, Q3 {errors.quartile3_m:.2f} m, "
        f"largest {errors.largest_m:.2f} m; within what it said {errors.within:.0%}; {counts}"
    )


def locate_by_python(twin: Path, run: Path, mode: str, out: Path) -> Fixes:
    """The fixes of `elfslam locate`."""
    elfslam("locate", twin, run, out, "--mode", mode)
    return read_fixes(out)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("world", nargs="?", default="studio")
    parser.add_argument("--map-seed", type=int, default=107)
    parser.add_argument("--seed", type=int, default=108)
    parser.add_argument("--rounds", type=int, default=2, help="of the walk that is located")
    parser.add_argument("--keep", type=Path, default=None, help="where the map is kept and used")
    given = parser.parse_args()
    if missing_programs() or not CHROMIUM:
        sys.exit(f"install first: {', '.join(missing_programs() or ['chromium'])}")
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        compare(given.world, given.map_seed, given.seed, given.rounds, folder)


def compare(world_name: str, map_seed: int, seed: int, rounds: int, folder: Path) -> None:
    """Map, get, stop the server, start the browser again, walk, and print."""
    world = load_world(world_name)
    course = plan_course(world, seed, rounds)
    address, world_in_map = prepared(world_name, map_seed, folder)
    run = next((folder / "map").rglob("trajectory.tum")).parent
    print(f"walk of {course.duration_s:.0f} s; the server is stopped", flush=True)
    twin = simulated_twin(world, seed, rounds, folder / "twin")
    for name, mode in MODES.items():
        placed = walk_once(course, address, mode, folder, seed)
        own = errors_of(placed.fixes, course.truth, world_in_map)
        python = locate_by_python(twin, run, mode, folder / f"python_{mode}.csv")
        print(told(f"{name}, page", own))
        print(told(f"{name}, Python", errors_of(python, course.truth, world_in_map)))
        print(
            f"  {placed.fixes_per_minute:.0f} fixes a minute; {placed.heard_share:.0%} of the "
            f"chirps heard; ready after {placed.ready_s:.1f} s; asked of the network: "
            f"{placed.requests or 'nothing'}",
            flush=True,
        )


def prepared(world: str, seed: int, folder: Path) -> tuple[str, Any]:
    """A map that a server made and a browser has got: the server's address, the world's pose.

    Made once in a folder that is kept.
    """
    told = folder / "prepared.json"
    if not told.is_file():
        with serving(folder / "data") as address:
            map_id, world_in_map = make_map(address, world, seed, 3)
            fetch_map(address, map_id, folder / "map")
            get_map(folder / "profile", address)
        told.write_text(json.dumps([address.partition("#")[0], list(world_in_map)]))
    address, world_in_map = json.loads(told.read_text())
    return address, world_in_map


def walk_once(course: Course, address: str, mode: str, folder: Path, seed: int) -> Placed:
    """One walk by a browser that was just started."""
    scratch = folder / f"sound_{mode}"
    scratch.mkdir(exist_ok=True)
    with (
        in_time(),
        pulse_audio(scratch) as environment,
        room_between(environment, course.responses, scratch, seed) as room,
        kept_browser(folder / "profile", environment) as context,
    ):
        page = open_page(context, address)
        return locate_walk(page, course, room, mode, folder)


# --- a server with a map ---


def upload_walk(
    client: httpx.Client, name: str, seed: int, rounds: int, world: str = "studio"
) -> Truth:
    """Simulate a walk and send it as a .zip; gives its truth, which is not sent."""
    recording, truth = simulate(load_world(world), seed, rounds=rounds)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "walk"
        write_recording(replace(recording, name=name), folder, chirp_description=describe_chirp())
        packed = io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            for file in folder.iterdir():
                archive.write(file, f"walk/{file.name}")
    told = {"Upload-Length": str(len(packed.getvalue()))}
    told["Upload-Metadata"] = metadata(filename=f"{name}.zip")
    content = packed.getvalue()
    client.post("/api/uploads", content=content, headers={**PIECE, **told}).raise_for_status()
    return truth


def start_job(client: httpx.Client, job: dict[str, Any]) -> None:
    """Queue a job."""
    client.post("/api/jobs", json=job).raise_for_status()


def wait_for_jobs(client: httpx.Client) -> None:
    """Until every recording is read and every job has ended."""
    until_s = time.monotonic() + LONGEST_S
    while time.monotonic() < until_s:
        receiving = any(
            each["state"] == "receiving" for each in client.get("/api/recordings").json()
        )
        open_ = any(
            each["state"] in ("queued", "running") for each in client.get("/api/jobs").json()
        )
        if not (receiving or open_):
            return
        time.sleep(2)
    raise SystemExit("the jobs take too long")


def put_plan(
    client: httpx.Client, floor: str, truths: dict[str, Truth], world: str = "studio"
) -> F64:
    """Draw the world's plan and lay it where the walks say that it lies; gives that pose."""
    plan, width_m = plan_of(world)
    address, kind = f"/api/maps/{floor}/floor-plan", {"Content-Type": "image/png"}
    client.put(address, content=plan, headers=kind).raise_for_status()
    walks = client.get(f"/api/maps/{floor}/view").json()["walks"]
    x_m, y_m, heading_rad = world_in_map_of(walks, truths)
    placement = {
        "width_m": width_m,
        "x_m": x_m,
        "y_m": y_m,
        "heading_rad": heading_rad,
        "opacity": 0.7,
    }
    client.put(f"{address}/placement", json=placement).raise_for_status()
    return np.array([x_m, y_m, heading_rad])


def world_in_map_of(
    walks: list[dict[str, Any]], truths: dict[str, Truth]
) -> tuple[float, float, float]:
    """The pose of the world in the map: the best rigid fit of true places to mapped ones."""
    mapped = np.vstack([walk["xy_m"] for walk in walks])
    true = np.vstack([truth_at(truth_of(truths, walk["name"]), walk["t_s"]) for walk in walks])
    middle_map, middle_true = mapped.mean(axis=0), true.mean(axis=0)
    one, other = (true - middle_true) @ [1, 1j], (mapped - middle_map) @ [1, 1j]
    heading_rad = float(np.angle(np.vdot(one, other)))
    corner = middle_map @ [1, 1j] - (middle_true @ [1, 1j]) * np.exp(1j * heading_rad)
    return float(corner.real), float(corner.imag), heading_rad


def truth_of(truths: dict[str, Truth], name: str) -> Truth:
    """That of a walk; a merge puts a mark behind its name."""
    return truths[name] if name in truths else truths[name.rpartition("-")[0]]


def truth_at(truth: Truth, t_s: list[float]) -> np.ndarray:
    """True places (n, 2) at some times."""
    columns = [np.interp(t_s, truth.t_s, truth.world_from_body[:, axis]) for axis in (0, 1)]
    return np.column_stack(columns)


def plan_of(name: str) -> tuple[bytes, float]:
    """A drawing of a world as PNG, and its width in metres."""
    told = tomllib.loads((Path(worlds.__path__[0]) / f"{name}.toml").read_text())
    width_m, depth_m = told["size_m"][:2]
    image = Image.new(
        "RGB", (round(width_m * PIXELS_PER_M), round(depth_m * PIXELS_PER_M)), "white"
    )
    draw = ImageDraw.Draw(image)
    for piece in told["furniture"]:
        (x, y, _), (w, d, _) = piece["corner_m"], piece["size_m"]
        box = [v * PIXELS_PER_M for v in (x, depth_m - y - d, x + w, depth_m - y)]
        draw.rectangle(box, fill="#eeeeee", outline="#777777", width=3)
        draw.text((box[0] + 8, box[1] + 8), piece["name"], fill="#555555", font_size=16)
    draw.rectangle([0, 0, image.width - 1, image.height - 1], outline="black", width=9)
    kept = io.BytesIO()
    image.save(kept, "PNG")
    return kept.getvalue(), float(width_m)


if __name__ == "__main__":
    main()

"""A walk by a real browser through a simulated room, and the same walk simulated without one.

    python -m studies.benchmarks.browser_walk [WORLD] [--seed N] [--rounds N] [--keep FOLDER]

The page plays chirps through a private sound server into the room of acoustic_loop.py, gets its
motion from the browser's own sensor override, records, and uploads to a server of its own, which
maps. Printed is the median error of that map, and that of the map of `simulate` with the same
world, seed and sensors.
Needs chromium, pulseaudio and the `test` extra.
"""

import argparse
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, Page, sync_playwright

from elfslam.base.values import Imu, Truth
from elfslam.data.recordings import write_recording
from elfslam.data.truth_files import write_truth
from elfslam.stages.chirp import describe_chirp
from elfslam.world.circumstances import (
    Circumstances,
    air_on,
    device_of,
    engine_of,
    reach_of,
    room_on,
)
from elfslam.world.device import BAND_BINS, BAND_LOW_HZ, BIN_HZ, BMI160, BROWSER
from elfslam.world.imu import read_imu
from elfslam.world.phone import room_responses
from elfslam.world.recorder import phone_poses
from elfslam.world.scene import scene_of
from elfslam.world.simulate import simulate
from elfslam.world.simulate import truth_of as truth_of_motion
from elfslam.world.walker import Motion, random_walker, walk
from elfslam.world.world_file import World, load_world
from studies.benchmarks.acoustic_loop import (
    FRAME,
    RATE_HZ,
    in_time,
    metronome,
    missing_programs,
    pulse_audio,
    room_between,
)
from studies.benchmarks.served import owner_of, serving

CHROMIUM = os.environ.get("CHROMIUM") or shutil.which("chromium") or ""
ARGUMENTS = (
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--use-fake-ui-for-media-stream",
    "--disable-renderer-backgrounding",
    "--disable-backgrounding-occluded-windows",
)
PERMISSIONS = ("microphone", "accelerometer", "gyroscope", "screen-wake-lock")
SENSORS = ("accelerometer", "gyroscope", "linear-acceleration")
INJECTED_HZ = 100.0
TOO_LATE = "came too late"
REST_S = 0.5 / INJECTED_HZ
"""Between two readings: whoever goes before other work must leave some time to the rest."""
LATE_S = 0.1
"""What the motion sensors read may come so late; a walk without a turn of which is another walk."""
HELD_UP_S = 0.3
"""What a process that only sleeps may be held up in a walk; beyond, sound and motion suffer too."""
SETTLED, SETTLED_MS = (
    re.compile("map is being made|map is ready|walk is on the server|Not sent"),
    3e5,
)
PAUSE_S = 0.6
"""Silence by which the room knows the chirps of the walk from those of the probe."""


@dataclass(frozen=True)
class Course:
    """A simulated walk, as the room and the sensors need it."""

    motion: Motion
    imu: Imu
    truth: Truth
    responses: np.ndarray

    @property
    def duration_s(self) -> float:
        """From standing to standing."""
        return float(self.motion.t_s[-1])


def plan_course(world: World, seed: int, rounds: int) -> Course:
    """The very walker and route of `simulate`, with responses for a chirp every 100 ms."""
    generator = np.random.default_rng([seed, 1])
    walker = random_walker(generator)
    motion = walk(walker, world.route_m, rounds, generator)
    imu = read_imu(motion, replace(BMI160, rate_hz=INJECTED_HZ), generator)
    today = Circumstances()
    device = device_of(today)
    t_s = np.arange(0.0, motion.t_s[-1], 0.1)
    poses = phone_poses(walker, motion, world, 0, seed, t_s)
    room = room_on(world, today)
    responses = room_responses(
        scene_of(room), device, poses, air_on(world, 0), reach_of(today),
        engine_of(today, room, 1),
    )  # fmt: skip
    band = np.fft.fftshift(np.fft.fft(responses, axis=1), axes=1) * device.level * device.response
    transfer = np.zeros((len(t_s), FRAME // 2 + 1), dtype=np.complex64)
    first = round(BAND_LOW_HZ / BIN_HZ)
    transfer[:, first : first + BAND_BINS] = band
    return Course(motion, imu, truth_of_motion(motion), transfer)


@contextmanager
def browsing(environment: dict[str, str]) -> Iterator[Browser]:
    """A browser whose loudspeaker and microphone are those of the sound server."""
    with sync_playwright() as play:
        browser = play.chromium.launch(
            executable_path=CHROMIUM,
            args=list(ARGUMENTS),
            ignore_default_args=["--mute-audio"],
            env={**environment},
        )
        yield browser
        browser.close()


class MotionSensors:
    """The browser's accelerometer and gyroscope, overridden."""

    def __init__(self, page: Page) -> None:
        self._session: Any = page.context.new_cdp_session(page)
        about = {"available": True, "minimumFrequency": 1, "maximumFrequency": 100}
        for kind in SENSORS:
            given = {"enabled": True, "type": kind, "metadata": about}
            self._session.send("Emulation.setSensorOverrideEnabled", given)
        self._send("linear-acceleration", np.zeros(3))

    def read(self, imu: Imu, t_s: float) -> None:
        """What the sensors read at a time of the walk, from now on; rests before it returns."""
        k = min(max(int(np.searchsorted(imu.t_s, t_s)), 0), len(imu.t_s) - 1)
        self._send("accelerometer", imu.accel_mps2[k])
        self._send("gyroscope", imu.gyro_radps[k])
        time.sleep(REST_S)

    def _send(self, kind: str, values: np.ndarray) -> None:
        xyz = dict(zip("xyz", map(float, values), strict=True))
        given = {"type": kind, "reading": {"xyz": xyz}}
        self._session.send("Emulation.setSensorOverrideReadings", given)


def walk_in_browser(page: Page, address: str, course: Course, room: Any, name: str) -> None:
    """From the first tap to the last. Raises RuntimeError where the machine was too busy."""
    page.goto(address)
    sensors = MotionSensors(page)
    sensors.read(course.imu, 0.0)
    page.click("#allow")
    _move_until(page, sensors, course, lambda: page.is_visible("#go-on"), 60.0)
    page.click("#go-on")
    page.fill("#walk-name", name)
    with metronome() as held_up_s:
        time.sleep(PAUSE_S)
        room.go()
        page.click("text=Start walking")
        late_s = _move(sensors, course, room.begun_s())
        print(f"late: motion {late_s:.2f} s, an idle process {held_up_s():.2f} s", flush=True)
        if late_s > LATE_S:
            raise RuntimeError(f"the motion {TOO_LATE}: {late_s:.2f} s")
        if held_up_s() > HELD_UP_S:
            raise RuntimeError(f"an idle process {TOO_LATE}: {held_up_s():.2f} s in all")
    page.click("#stop")


def _wait_until_sent(page: Page) -> None:
    """Until the server has the walk: its map may be made, or refused, before anybody looks."""
    page.locator("#finish-said").filter(has_text=SETTLED).wait_for(timeout=SETTLED_MS)
    if "Not sent" in page.inner_text("#finish-said"):
        raise RuntimeError(f"the walk is not sent: {page.inner_text('#finish-trouble')}")


def _move(sensors: MotionSensors, course: Course, begun_s: float) -> float:
    """The motion of the walk from its begin on; gives the longest time that a reading stood (s)."""
    longest_s, last = 0.0, time.monotonic()
    while (now := time.monotonic()) < begun_s + course.duration_s:
        longest_s = max(longest_s, now - last)
        sensors.read(course.imu, now - begun_s)
        last = now
    return longest_s


def _move_until(
    page: Page, sensors: MotionSensors, course: Course, done: Any, most_s: float
) -> None:
    until = time.monotonic() + most_s
    while not done():
        if time.monotonic() > until:
            raise RuntimeError(f"the page does not go on: {page.inner_text('main')[:500]}")
        sensors.read(course.imu, 0.0)


def download(address: str, folder: Path) -> Path:
    """The one recording of the server, as a folder."""
    with owner_of(address) as client:
        recordings = client.get("/api/recordings").raise_for_status().json()
        archive = client.get(f"/api/recordings/{recordings[0]['id']}/recording.zip")
    out = folder / "recorded"
    zipfile.ZipFile(io.BytesIO(archive.raise_for_status().content)).extractall(out)
    return next(out.rglob("recording.json")).parent


def finished_map(address: str, folder: Path, most_s: float = 900.0) -> Path:
    """The map that the server makes of it, as a run folder. Waits for it."""
    until = time.monotonic() + most_s
    with owner_of(address) as client:
        while time.monotonic() < until:
            jobs = client.get("/api/jobs").raise_for_status().json()
            if jobs and jobs[0]["state"] in ("done", "failed", "cancelled"):
                break
            time.sleep(2)
        else:
            raise RuntimeError("the server did not finish the map in time")
        if jobs[0]["state"] != "done":
            raise RuntimeError(f"the server made no map: {jobs[0]['problem']}")
        archive = client.get(f"/api/maps/{jobs[0]['gave']['map']}/map.zip").raise_for_status()
    out = folder / "mapped"
    zipfile.ZipFile(io.BytesIO(archive.content)).extractall(out)
    return next(out.rglob("trajectory.tum")).parent


def simulated_twin(world: World, seed: int, rounds: int, folder: Path) -> Path:
    """The same walk by `simulate`, with the sensors that a page gets."""
    recording, truth = simulate(world, seed, rounds=rounds, rate_hz=RATE_HZ, grade=BROWSER)
    write_recording(recording, folder, chirp_description=describe_chirp(), truth=truth)
    return folder


def truth_of(course: Course, recorded: Path) -> Truth:
    """The truth on the recording's clock: the walk begins with its first chirp."""
    return Truth(course.truth.t_s + first_chirp_s(recorded), course.truth.world_from_body)


def first_chirp_s(recorded: Path) -> float:
    """When the first direct arrival was heard."""
    table = next(
        file for file in map(recorded.joinpath, ("baseband.csv", "frames.csv")) if file.is_file()
    )
    return float(np.loadtxt(table, delimiter=",", skiprows=1, usecols=0, ndmin=1)[0]) + 0.005


def elfslam(*arguments: object) -> str:
    """Run a verb of the command; gives what it prints."""
    command = [sys.executable, "-c", "from elfslam.cli import main; main()", *map(str, arguments)]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def errors_of(run: Path, truth: Path) -> dict[str, float]:
    """Median errors (m) of a map, by alignment, and of dead reckoning where it is aligned."""
    rows = json.loads(elfslam("score", run, truth, "--json"))
    found = {row["alignment"]: row["median_m"] for row in rows if row.get("method") == "SLAM"}
    reckoned = next(
        row["median_m"]
        for row in rows
        if (row.get("method"), row.get("alignment")) == ("dead reckoning", "aligned")
    )
    return {**found, "dead reckoning, aligned": reckoned}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("world", nargs="?", default="studio")
    parser.add_argument("--seed", type=int, default=107)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--keep", type=Path, default=None)
    given = parser.parse_args()
    if missing_programs() or not CHROMIUM:
        sys.exit(f"install first: {', '.join(missing_programs() or ['chromium'])}")
    world = load_world(given.world)
    course = plan_course(world, given.seed, given.rounds)
    print(f"walk of {course.duration_s:.0f} s", flush=True)
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        for name, errors in compare(world, course, folder, given.seed, given.rounds).items():
            told = ", ".join(
                f"{alignment} {error_m:.2f} m" for alignment, error_m in errors.items()
            )
            print(f"{name}: {told}", flush=True)


def compare(
    world: World, course: Course, folder: Path, seed: int, rounds: int
) -> dict[str, dict[str, float]]:
    """Median errors of the walk by browser and of the same walk simulated."""
    recorded, run = walk_and_map(course, folder, f"{world.name} {seed}", seed)
    write_truth(truth_of(course, recorded), recorded)
    twin = simulated_twin(world, seed, rounds, folder / "twin")
    elfslam("map", twin, folder / "twin_run")
    return {"browser": errors_of(run, recorded), "simulated": errors_of(folder / "twin_run", twin)}


def walk_and_map(course: Course, folder: Path, name: str, seed: int = 0) -> tuple[Path, Path]:
    """The recording and the map that come of a walk by browser, as folders."""
    with serving(folder / "data") as address:
        with (
            in_time(),
            pulse_audio(folder) as environment,
            room_between(environment, course.responses, folder, seed) as room,
            browsing(environment) as browser,
        ):
            context = browser.new_context(permissions=list(PERMISSIONS), reduced_motion="reduce")
            page = context.new_page()
            page.on("pageerror", lambda error: print("page:", error.stack or error, flush=True))
            walk_in_browser(page, address, course, room, name)
            _wait_until_sent(page)
        return download(address, folder), finished_map(address, folder)


if __name__ == "__main__":
    main()

"""Pictures of the phone page, light and dark, into docs/phone/.

    python -m studies.benchmarks.phone_screenshots [FOLDER [STATE...]]

A real server, a real browser, and the simulated room of acoustic_loop.py. Needs chromium,
pulseaudio and the `test` extra.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from PIL import Image

from elfslam.world.world_file import load_world
from studies.benchmarks.acoustic_loop import in_time, pulse_audio, room_between
from studies.benchmarks.browser_walk import (
    PAUSE_S,
    PERMISSIONS,
    Course,
    MotionSensors,
    browsing,
    plan_course,
)
from studies.benchmarks.page_place import make_map
from studies.benchmarks.served import serving

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "phone"
SIZE = {"width": 375, "height": 740}
STATES = ("start", "probe", "name", "record", "sent", "unfinished", "interrupted", "no_network")
PLACES = ("maps", "place", "place_doubt", "place_offline")
MAPS = {"Studio, ground floor": 107, "Studio, last autumn": 105}
PROFILE: dict[str, Any] = {
    "permissions": list(PERMISSIONS),
    "viewport": SIZE,
    "device_scale_factor": 2,
    "has_touch": True,
    "reduced_motion": "reduce",
}
SETTLING_S = 0.4
TAKE_AWAY = """
const ask = navigator.mediaDevices?.getUserMedia.bind(navigator.mediaDevices);
let taken = [];
if (ask) navigator.mediaDevices.getUserMedia = async (wanted) => {
  const stream = await ask(wanted);
  taken = stream.getAudioTracks();
  return stream;
};
window.takeMicrophone = () => taken.forEach((track) => {
  track.stop();
  track.dispatchEvent(new Event("ended"));
});
"""
"""A call ends the track of the microphone; no browser lets a program make one."""


def main() -> None:
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    wanted = sys.argv[2:] or [*STATES, *PLACES]
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        if set(wanted) & set(STATES):
            photograph_walk(scratch)
        if set(wanted) & set(PLACES):
            photograph_places(scratch)
        for state in wanted:
            side_by_side(
                [scratch / f"{scheme}_{state}.png" for scheme in ("light", "dark")],
                folder / f"{state}.png",
            )


def photograph_walk(scratch: Path) -> None:
    """A walk that is recorded and sent."""
    course = plan_course(load_world("studio"), 107, 1)
    with (
        serving(scratch / "data") as address,
        in_time(),
        pulse_audio(scratch) as environment,
        room_between(environment, course.responses, scratch),
        browsing(environment) as browser,
    ):
        for scheme in ("light", "dark"):
            context = browser.new_context(**PROFILE, color_scheme=scheme)
            photograph(context.new_page(), address, course, scratch / scheme)
            context.close()


def photograph_places(scratch: Path) -> None:
    """Another walker who is located, in the room and where its sound is gone."""
    course = plan_course(load_world("studio"), 108, 2)
    with serving(scratch / "places") as address:
        for name, seed in MAPS.items():
            make_map(address, "studio", seed, 3, name)
        for scheme in ("light", "dark"):
            folder = scratch / f"sound_{scheme}"
            folder.mkdir()
            with (
                in_time(),
                pulse_audio(folder) as environment,
                room_between(environment, course.responses, folder) as room,
                browsing(environment) as browser,
            ):
                context = browser.new_context(**PROFILE, color_scheme=scheme)
                photograph_place(context.new_page(), address, course, room, scratch / scheme)
                context.close()


def photograph_place(page: Any, address: str, course: Course, room: Any, prefix: Path) -> None:
    """Choosing a map, being located, not being sure, and without a server."""

    def shoot(state: str) -> None:
        page.wait_for_timeout(1000 * SETTLING_S)
        page.screenshot(path=f"{prefix}_{state}.png")

    page.goto(address)
    sensors = MotionSensors(page)
    sensors.read(course.imu, 0.0)
    page.click("#where")
    page.click(f"li:has-text('{next(iter(MAPS))}') >> text=Get this map")
    page.wait_for_selector("text=Find me here")
    shoot("maps")
    page.locator("html[data-offline=kept]").wait_for()
    page.click("text=Find me here")
    page.wait_for_selector("#place-stop:visible")
    page.click("#place-stop")
    page.wait_for_timeout(1000 * PAUSE_S)
    room.go()
    page.click("#place-start")
    begun_s = room.begun_s()
    walk_until(sensors, course, begun_s, 0.55 * course.duration_s)
    page.screenshot(path=f"{prefix}_place.png")
    room.hush()
    walk_until(sensors, course, begun_s, 0.55 * course.duration_s + 6.0)
    page.screenshot(path=f"{prefix}_place_doubt.png")
    page.click("#place-stop")
    page.context.set_offline(True)
    page.goto(address.partition("#")[0])
    page.locator("#problem", has_text="work without it").wait_for()
    page.click("#where")
    page.locator("#maps-trouble", has_text="work without it").wait_for()
    shoot("place_offline")


def walk_until(sensors: MotionSensors, course: Course, begun_s: float, until_s: float) -> None:
    """Move as the walker does, who set off at `begun_s`."""
    while (now_s := time.monotonic() - begun_s) < until_s:
        sensors.read(course.imu, now_s)


def photograph(page: Any, address: str, course: Course, prefix: Path) -> None:
    """Every state of the page, in the order in which a walker sees them."""

    def shoot(state: str, *, whole: bool = False) -> None:
        page.wait_for_timeout(1000 * SETTLING_S)
        page.screenshot(path=f"{prefix}_{state}.png", full_page=whole)

    page.on("dialog", lambda dialog: dialog.accept())
    page.add_init_script(TAKE_AWAY)
    page.goto(address)
    shoot("start")
    sensors = MotionSensors(page)
    page.click("#allow")
    walk_for(page, sensors, course, 4.0)
    page.wait_for_selector("#checks li")
    shoot("probe", whole=True)
    page.click("#go-on")
    page.fill("#walk-name", "Ground floor, twice around")
    page.click("text=Start and sound")
    shoot("name", whole=True)
    page.click("text=Start walking")
    walk_for(page, sensors, course, 9.0)
    shoot("record")
    page.context.set_offline(True)
    walk_for(page, sensors, course, 4.0)
    shoot("no_network")
    page.context.set_offline(False)
    page.reload()
    page.wait_for_selector("#unfinished-walks li")
    shoot("unfinished")
    page.click("text=Go on walking")
    walk_for(page, sensors, course, 4.0)
    page.evaluate("() => window.takeMicrophone()")
    page.wait_for_selector("#resume:visible")
    shoot("interrupted")
    page.click("#stop")
    page.get_by_text("map is being made").wait_for(timeout=120_000)
    shoot("sent")


def walk_for(page: Any, sensors: MotionSensors, course: Course, seconds: float) -> None:
    """Move as the walker does."""
    begun_s = time.monotonic()
    while (now_s := time.monotonic() - begun_s) < seconds:
        sensors.read(course.imu, 3.0 + now_s)


def side_by_side(files: list[Path], out: Path) -> None:
    """Light beside dark, in few colours so that the file stays small."""
    pictures = [Image.open(file).convert("RGB") for file in files]
    height = max(picture.height for picture in pictures)
    both = Image.new("RGB", (sum(picture.width for picture in pictures), height), "#7f8a85")
    at = 0
    for picture in pictures:
        both.paste(picture, (at, 0))
        at += picture.width
    small = both.resize((both.width * 3 // 5, both.height * 3 // 5), Image.Resampling.LANCZOS)
    small.quantize(256, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        out, optimize=True
    )


if __name__ == "__main__":
    main()

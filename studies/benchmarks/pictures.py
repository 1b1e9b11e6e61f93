"""Pictures of the pages for the docs: a real server, real jobs, a real browser, a simulated room.

    python -m studies.benchmarks.pictures [desk] [phone] [--out docs] [--states probe,record]

The desk: three walks and a visitor are simulated in the studio, uploaded, mapped, merged and
located; a floor plan is drawn from the world and laid under the map. The phone: a walk through the
room of acoustic_loop.py, and another walker who is located there. Light and dark. Takes minutes;
needs chromium, pulseaudio and the `test` extra.
"""

from __future__ import annotations

import argparse
import io
import tempfile
import time
from collections.abc import Collection
from pathlib import Path
from typing import Any

import httpx
import numpy as np
from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

from elfslam.base.arrays import F64
from elfslam.base.geometry import compose
from elfslam.world.world_file import load_world
from studies.benchmarks.acoustic_loop import in_time, pulse_audio, room_between
from studies.benchmarks.browser_walk import (
    CHROMIUM,
    PAUSE_S,
    PERMISSIONS,
    Course,
    MotionSensors,
    browsing,
    plan_course,
)
from studies.benchmarks.page_place import make_map, put_plan, start_job, upload_walk, wait_for_jobs
from studies.benchmarks.served import owner_of, serving

SCHEMES: tuple[Any, ...] = ("light", "dark")
WALKS = {"First walk": (100, 3), "Second walk": (101, 3), "Third walk": (102, 3)}
VISITOR = ("A visitor", (200, 1))
VENUE, FLOORS = "North Mall", ("Ground floor", "Floor 1")
PLACES = {"Way in": ("door", 1.2, 1.0), "Stairs": ("stairs", 6.9, 5.6), "Desk": ("room", 5.4, 4.9)}
"""By name their kind, and where they are in the world."""
ME, OTHERS = "Ada", ("Eve", "The facility team")
COLOURS = 256
DESK_SIZE: Any = {"width": 1280, "height": 800}
SIZE = {"width": 375, "height": 740}
STATES = ("start", "probe", "name", "record", "sent", "unfinished", "interrupted", "no_network")
MAP_STATES = ("maps", "place", "place_doubt", "place_offline")
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
    """Write the pictures into `desk/` and `phone/` of a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("pages", nargs="*", default=["desk", "phone"])
    parser.add_argument("--out", type=Path, default=Path("docs"))
    parser.add_argument("--states", default=",".join([*STATES, *MAP_STATES]), help="of the phone")
    asked = parser.parse_args()
    for page in asked.pages:
        (asked.out / page).mkdir(parents=True, exist_ok=True)
    if "desk" in asked.pages:
        photograph_desk(asked.out / "desk")
    if "phone" in asked.pages:
        photograph_phone(asked.out / "phone", asked.states.split(","))


# --- the desk ---


def photograph_desk(out: Path) -> None:
    """Recordings, maps, how one is shared, and that map with its plan."""
    with tempfile.TemporaryDirectory() as data, serving(Path(data)) as address:
        with owner_of(address.replace("/desk", "/")) as client:
            floor = fill(client)
        with sync_playwright() as play:
            browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            for scheme in SCHEMES:
                take(browser, address.replace("/desk", "/"), scheme, floor, out)
            browser.close()


def fill(client: httpx.Client) -> str:
    """Upload, map, merge and locate; gives the id of the floor map, its plan in place."""
    truths = {name: upload_walk(client, name, *how) for name, how in [*WALKS.items(), VISITOR]}
    wait_for_jobs(client)
    lay_on_floors(client)
    maps = [each for each in client.get("/api/maps").json() if each["name"] in WALKS]
    start_job(client, {"kind": "merge", "maps": [each["id"] for each in maps], "name": "Studio"})
    wait_for_jobs(client)
    floor = next(each["id"] for each in client.get("/api/maps").json() if each["kind"] == "floor")
    recordings = client.get("/api/recordings").json()
    visitor = next(each["id"] for each in recordings if each["name"] == VISITOR[0])
    start_job(client, {"kind": "locate", "recording": visitor, "map": floor})
    name_places(client, floor, put_plan(client, floor, truths))
    share(client, floor)
    wait_for_jobs(client)
    first = next(each["id"] for each in recordings if each["name"] in WALKS)
    start_job(client, {"kind": "map", "recording": first, "by": ["elf"]})
    return str(floor)


def lay_on_floors(client: httpx.Client) -> None:
    """The walks on one floor of a venue, the visitor's on another."""
    for each in client.get("/api/maps").json():
        place = {"venue": VENUE, "floor": FLOORS[each["name"] not in WALKS]}
        client.patch(f"/api/maps/{each['id']}", json=place).raise_for_status()


def share(client: httpx.Client, floor: str) -> None:
    """Let two people in, one of whom may see the map; so may everyone who has its link."""
    client.patch("/api/me", json={"name": ME}).raise_for_status()
    ids = [client.post("/api/users", json={"name": name}).json()["id"] for name in OTHERS]
    may = {"may": "read"}
    client.put(f"/api/maps/{floor}/shares/{ids[0]}", json=may).raise_for_status()
    client.put(f"/api/maps/{floor}/link", json=may).raise_for_status()


def name_places(client: httpx.Client, floor: str, map_from_world: F64) -> None:
    """Give places of the world their names on its map."""
    named = []
    for name, (kind, *where_m) in PLACES.items():
        x_m, y_m, _ = compose(map_from_world, np.array([*where_m, 0.0])).tolist()
        named.append({"name": name, "kind": kind, "x_m": x_m, "y_m": y_m})
    change = {"version": "", "points": named}
    client.put(f"/api/maps/{floor}/points-of-interest", json=change).raise_for_status()


def take(browser: Browser, address: str, scheme: Any, floor: str, out: Path) -> None:
    """The recordings, the maps, how one is shared, and that map with its plan."""
    page = browser.new_page(viewport=DESK_SIZE, color_scheme=scheme)
    page.goto(address.replace("/#", "/desk#"))
    page.wait_for_selector("table.list")
    page.wait_for_timeout(2500)
    keep(page, out / f"recordings_{scheme}.png")
    page.evaluate("() => { location.hash = '#/maps'; }")
    page.get_by_role("heading", name=VENUE).wait_for()
    keep(page, out / f"maps_{scheme}.png")
    page.get_by_role("button", name="Share Studio").click()
    page.get_by_role("textbox", name="Address").wait_for()
    keep(page, out / f"share_{scheme}.png")
    page.get_by_role("button", name="Close").click()
    page.evaluate("id => { location.hash = `#/maps/${id}`; }", floor)
    page.get_by_role("button", name="Move the plan").wait_for()
    page.get_by_text("located", exact=True).wait_for()
    page.get_by_role("button", name="Show all").click()
    page.wait_for_timeout(1500)
    keep(page, out / f"map_{scheme}.png")
    page.close()


def keep(page: Page, file: Path) -> None:
    """A picture in few colours, so that it stays small."""
    shot = Image.open(io.BytesIO(page.screenshot()))
    shot.convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE).save(file, optimize=True)
    print(f"{file}: {file.stat().st_size / 1000:.0f} kB")


# --- the phone ---


def photograph_phone(out: Path, states: Collection[str]) -> None:
    """Each state of the page, light beside dark."""
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        if set(states) & set(STATES):
            photograph_walk(scratch)
        if set(states) & set(MAP_STATES):
            photograph_places(scratch)
        for state in states:
            both = [scratch / f"{scheme}_{state}.png" for scheme in SCHEMES]
            side_by_side(both, out / f"{state}.png")


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
        for scheme in SCHEMES:
            context = browser.new_context(**PROFILE, color_scheme=scheme)
            photograph(context.new_page(), address, course, scratch / scheme)
            context.close()


def photograph_places(scratch: Path) -> None:
    """Another walker who is located, in the room and where its sound is gone."""
    course = plan_course(load_world("studio"), 108, 2)
    with serving(scratch / "places") as address:
        for name, seed in MAPS.items():
            make_map(address, "studio", seed, 3, name)
        for scheme in SCHEMES:
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
    walk_on(sensors, course, 0.55 * course.duration_s, begun_s)
    page.screenshot(path=f"{prefix}_place.png")
    room.hush()
    walk_on(sensors, course, 0.55 * course.duration_s + 6.0, begun_s)
    page.screenshot(path=f"{prefix}_place_doubt.png")
    page.click("#place-stop")
    page.context.set_offline(True)
    page.goto(address.partition("#")[0])
    page.locator("#problem", has_text="work without it").wait_for()
    page.click("#where")
    page.locator("#maps-trouble", has_text="work without it").wait_for()
    shoot("place_offline")


def walk_on(
    sensors: MotionSensors, course: Course, seconds: float, begun_s: float | None = None
) -> None:
    """Move as the walker does, who set off 3 s ago where it is not said when, up to a time."""
    begun_s, ahead_s = (time.monotonic(), 3.0) if begun_s is None else (begun_s, 0.0)
    while (now_s := time.monotonic() - begun_s) < seconds:
        sensors.read(course.imu, ahead_s + now_s)


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
    walk_on(sensors, course, 4.0)
    page.wait_for_selector("#checks li")
    shoot("probe", whole=True)
    page.click("#go-on")
    page.fill("#walk-name", "Ground floor, twice around")
    page.click("text=Start and sound")
    shoot("name", whole=True)
    page.click("text=Start walking")
    walk_on(sensors, course, 9.0)
    shoot("record")
    page.context.set_offline(True)
    walk_on(sensors, course, 4.0)
    shoot("no_network")
    page.context.set_offline(False)
    page.reload()
    page.wait_for_selector("#unfinished-walks li")
    shoot("unfinished")
    page.click("text=Go on walking")
    walk_on(sensors, course, 4.0)
    page.evaluate("() => window.takeMicrophone()")
    page.wait_for_selector("#resume:visible")
    shoot("interrupted")
    page.click("#stop")
    page.get_by_text("map is being made").wait_for(timeout=120_000)
    shoot("sent")


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

"""The whole story: pair, map two walks, plan, share, a guest locates, a program listens.

Usage, from the root of the project:

    python -m studies.benchmarks.whole_story FOLDER [--install]

A real server with real jobs, browsers for the desk and the phones, and a simulated room between
each phone's loudspeaker and microphone. Prints of each chapter how long it took, and how often
somebody tapped or typed; pictures of it, light and dark, go into FOLDER. `--install` begins with a
new environment.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx
from playwright.sync_api import Browser, Locator, Page, sync_playwright

from elfslam.app.console import print_rows, say
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
from studies.benchmarks.desk_pictures import keep, plan_of
from studies.benchmarks.phone_screenshots import walk_until
from studies.benchmarks.served import serving

WORLD = "studio"
WALKS = {"Morning": 107, "Noon": 105}
GUEST_SEED, ROUNDS = 108, 3
ROOT = Path(__file__).resolve().parents[2]
DESK, PHONE = {"width": 1280, "height": 800}, {"width": 390, "height": 844}
LONGEST_MS = 120_000


@dataclass
class Story:
    """What has happened so far: a row for each chapter."""

    folder: Path
    rows: list[dict[str, object]] = field(default_factory=list)
    taps: int = 0
    typed: int = 0

    @contextmanager
    def chapter(self, name: str) -> Iterator[None]:
        """One of them; says how long it took when it ends."""
        self.taps = self.typed = 0
        begun_s = time.monotonic()
        yield
        seconds = round(time.monotonic() - begun_s)
        row = {"chapter": name, "seconds": seconds, "taps": self.taps, "typed": self.typed}
        self.rows.append(row)
        say(f"{name}: {seconds} s")

    def tap(self, what: Locator) -> None:
        """Tap, and count it."""
        what.click(timeout=LONGEST_MS)
        self.taps += 1

    def fill(self, what: Locator, text: str) -> None:
        """Type, and count it."""
        what.fill(text)
        self.typed += 1

    def look(self, page: Page, name: str) -> None:
        """Pictures of a page as it is now."""
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
            page.wait_for_timeout(400)
            keep(page, self.folder / f"{name}_{scheme}.png")


def main() -> None:
    """Tell it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--install", action="store_true", help="install into a new environment")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    story = Story(asked.folder)
    with tempfile.TemporaryDirectory() as name:
        if asked.install:
            install(story, Path(name) / "environment")
        tell(story, Path(name))
    print_rows(story.rows, title="The whole story", as_json=False)


def install(story: Story, folder: Path) -> None:
    """As the README says, for a server alone."""
    with story.chapter("install"):
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        pip = [str(folder / "bin" / "pip"), "install", "--quiet", "--constraint"]
        subprocess.run([*pip, str(ROOT / "constraints.txt"), f"{ROOT}[serve]"], check=True)


def tell(story: Story, scratch: Path) -> None:
    """From the first address to a position in another program."""
    with serving(scratch / "data") as address:
        with story.chapter("pair"), at_desk(address) as desk:
            story.tap(desk.get_by_role("button", name="Pair a device"))
            code = desk.get_by_role("textbox", name="Address").input_value()
            story.look(desk, "pair")
            story.tap(desk.get_by_role("button", name="Close"))
        courses = {name: course_of(seed) for name, seed in WALKS.items()}
        cookies: Any = None
        for name, course in courses.items():
            with story.chapter(f"walk {name}"), phone(scratch / name, course, cookies) as held:
                cookies = walk(story, *held, course, code if cookies is None else address, name)
        with at_desk(address) as desk:
            floor = merged(story, desk)
            link = shared(story, desk, floor)
        guest = course_of(GUEST_SEED)
        with story.chapter("a guest locates"), phone(scratch / "guest", guest, None) as held:
            story_of_guest(story, *held, guest, link, floor)
        with story.chapter("a program listens"), phone(scratch / "told", guest, cookies) as held:
            listened(story, *held, guest, address, floor)


@contextmanager
def at_desk(address: str) -> Iterator[Page]:
    """The owner's desk; closed before a phone is taken up, whose browser hears another room."""
    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport=DESK)  # type: ignore[arg-type]
        page.goto(address.replace("/#", "/desk#"))
        page.wait_for_selector("nav:not([hidden])")
        yield page
        browser.close()


def course_of(seed: int) -> Course:
    """A walk through the room, and what is heard on it."""
    return plan_course(load_world(WORLD), seed, ROUNDS)


@contextmanager
def phone(folder: Path, course: Course, cookies: Any) -> Iterator[tuple[Page, Any]]:
    """A phone in the room; gives its page and the room."""
    folder.mkdir()
    with (
        in_time(),
        pulse_audio(folder) as environment,
        room_between(environment, course.responses, folder) as room,
        browsing(environment) as browser,
    ):
        yield page_of(browser, cookies), room


def page_of(browser: Browser, cookies: Any) -> Page:
    """A new page, of a phone that is paired where cookies say so."""
    context = browser.new_context(
        permissions=list(PERMISSIONS),
        viewport=PHONE,  # type: ignore[arg-type]
        has_touch=True,
        reduced_motion="reduce",
        storage_state=cookies,
    )
    return context.new_page()


def walk(story: Story, page: Page, room: Any, course: Course, address: str, name: str) -> Any:
    """A walk that is recorded, and its map; gives what pairs the phone from now on."""
    page.goto(address)
    sensors = MotionSensors(page)
    sensors.read(course.imu, 0.0)
    story.tap(page.locator("#allow"))
    story.tap(page.locator("#go-on"))
    story.fill(page.locator("#walk-name"), name)
    page.wait_for_timeout(1000 * PAUSE_S)
    room.go()
    story.tap(page.get_by_role("button", name="Start walking"))
    begun_s = room.begun_s()
    walk_until(sensors, course, begun_s, 0.8 * course.duration_s)
    keep(page, story.folder / f"walk_{name}.png")  # one alone: meanwhile nobody walks
    walk_until(sensors, course, begun_s, course.duration_s)
    story.tap(page.locator("#stop"))
    ended = page.locator("#see-map:visible, #finish-trouble:visible").first
    ended.wait_for(timeout=LONGEST_MS)
    if not page.locator("#see-map").is_visible():
        raise SystemExit(f"no map of {name}: {page.inner_text('#finish')}")
    story.look(page, f"mapped_{name}")
    return page.context.storage_state()


def merged(story: Story, desk: Page) -> str:
    """Both walks as one floor, a plan under them; gives its name."""
    floor = "Studio"
    with story.chapter("merge"):
        story.tap(desk.get_by_role("link", name="Maps"))
        for name in WALKS:
            story.tap(desk.get_by_label(f"Choose {name}", exact=True))
        story.tap(desk.get_by_role("button", name="Merge 2 maps"))
        dialog = desk.get_by_role("dialog")
        story.fill(dialog.get_by_label("Name"), floor)
        story.tap(dialog.get_by_role("button", name="Merge", exact=True))
        desk.get_by_role("link", name=f"Open {floor}").wait_for(timeout=LONGEST_MS)
        story.look(desk, "merged")
    with story.chapter("floor plan"):
        content, width_m = plan_of(WORLD)
        plan = story.folder / "plan.png"
        plan.write_bytes(content)
        story.tap(desk.get_by_role("link", name=f"Open {floor}"))
        desk.locator("input[name=plan-file]").set_input_files(plan)
        story.taps += 2  # the button, and the file among others
        story.fill(desk.locator("input[name=plan-width]"), f"{width_m}")
        desk.get_by_text("Saved", exact=True).wait_for()
        story.look(desk, "floor_plan")
        plan.unlink()
    return floor


def shared(story: Story, desk: Page, floor: str) -> str:
    """With everyone who has the link, which it gives."""
    with story.chapter("share"):
        story.tap(desk.get_by_role("button", name=f"Share {floor}"))
        dialog = desk.get_by_role("dialog", name=f"Share {floor}")
        may = dialog.get_by_label("What everyone may do who has the link")
        may.select_option("read")
        story.taps += 2
        link = dialog.get_by_role("textbox", name="Address").input_value()
        story.look(desk, "share")
        story.tap(dialog.get_by_role("button", name="Close"))
    return link


def story_of_guest(
    story: Story, page: Page, room: Any, course: Course, link: str, floor: str
) -> None:
    """Somebody without an account, from the link to their place."""
    page.goto(link)
    story.tap(page.get_by_role("link", name="Find me here"))
    located(story, page, room, course, floor)
    story.look(page, "guest")


def listened(story: Story, page: Page, room: Any, course: Course, address: str, floor: str) -> None:
    """The owner lets others see where they are; a program asks."""
    page.goto(address)
    story.tap(page.locator("#where"))
    sensors, begun_s = located(story, page, room, course, floor)
    story.tap(page.get_by_role("switch", name="Let others see where I am"))
    story.look(page, "told")
    url, token = address.partition("&")[0].split("/#token=")
    client = httpx.Client(base_url=url, headers={"Authorization": f"Bearer {token}"}, timeout=30)
    maps = client.get("/api/maps").json()
    [map_id] = [each["id"] for each in maps if each["name"] == floor]
    until_s = time.monotonic() + 30
    while time.monotonic() < until_s:
        walk_until(sensors, course, begun_s, time.monotonic() - begun_s + 0.5)
        page.wait_for_timeout(50)  # the page's own timers
        found = client.get(f"/api/maps/{map_id}/positions").json()
        if any(each["x_m"] is not None for each in found):
            say(f"a program reads: {found[0]}")
            return
    raise SystemExit("no position came")


def located(
    story: Story, page: Page, room: Any, course: Course, floor: str
) -> tuple[MotionSensors, float]:
    """From the list of maps to a place on one; gives what moves on, and when the walk began."""
    card = page.locator(".map-card", has_text=floor)
    story.tap(card.get_by_role("button", name="Get this map"))
    card.get_by_role("button", name="Find me here").wait_for()
    sensors = MotionSensors(page)
    sensors.read(course.imu, 0.0)
    room.go()
    story.tap(card.get_by_role("button", name="Find me here"))
    begun_s = room.begun_s()
    here = page.locator("#place-status", has_text="Here, within")
    while not here.is_visible() and time.monotonic() - begun_s < 0.8 * course.duration_s:
        walk_until(sensors, course, begun_s, time.monotonic() - begun_s + 0.5)
    here.wait_for(timeout=5000)
    return sensors, begun_s


if __name__ == "__main__":
    main()

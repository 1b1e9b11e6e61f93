"""The first minute without a phone, filmed and timed: a building, a walk, its map, somebody found.

    python -m studies.film [--clone]

A real server and a real browser (chromium) make `docs/phone/film.gif`, in about a minute, and print
what each step took, of seconds and taps. With `--clone` they are those of a fresh clone, whose
installation is timed as well.
"""

import argparse
import io
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from elfslam.app.console import print_rows
from studies.benchmarks.browser_walk import CHROMIUM
from studies.benchmarks.served import COMMAND, serving
from studies.reached import ROOT

FILM = ROOT / "docs" / "phone" / "film.gif"
PHONE, WIDTH_PX = {"width": 390, "height": 760}, 300
EVERY_MS, COLOURS = 500, 48
HOLD = 3
"""Pictures for which something to read stays."""
INSTALLED = (".venv/.installed-serve", ".venv/.kernels")
"""What `make serve` makes before it serves."""


class Clock:
    """What steps took since the one before."""

    def __init__(self) -> None:
        self._then_s = time.monotonic()
        self.rows: list[dict[str, object]] = []

    def ends(self, step: str, taps: int = 0) -> None:
        """Note the step that ends now."""
        now_s = time.monotonic()
        self.rows.append({"step": step, "taps": taps, "seconds": round(now_s - self._then_s, 1)})
        self._then_s = now_s


class Visitor:
    """Somebody who taps on a page and watches it; pictures are taken while they wait."""

    def __init__(self, page: Page, clock: Clock) -> None:
        self._page, self._clock, self._taps = page, clock, 0
        self.pictures: list[Image.Image] = []

    def tap(self, selector: str) -> None:
        """Tap on what is there."""
        self._page.locator(selector).first.scroll_into_view_if_needed()
        self.look()
        self._page.locator(selector).first.click()
        self._taps += 1

    def look(self, count: int = HOLD) -> None:
        """The page as it is, for so many pictures; nobody watches one for longer."""
        shot = Image.open(io.BytesIO(self._page.screenshot())).convert("RGB")
        size = (WIDTH_PX, round(shot.height * WIDTH_PX / shot.width))
        small = shot.resize(size, Image.Resampling.LANCZOS)
        picture = small.quantize(COLOURS, dither=Image.Dither.NONE)
        same = [each for each in self.pictures[-HOLD:] if each.tobytes() == picture.tobytes()]
        self.pictures += (count - len(same)) * [picture]

    def until(self, step: str, happened: Callable[[], bool], most: int = 240) -> None:
        """Watch until a step is done. Raises RuntimeError where it never is."""
        for _ in range(most):
            self.look(1)
            if happened():
                self._clock.ends(step, self._taps)
                self._taps = 0
                return self.look()
            self._page.wait_for_timeout(EVERY_MS)
        raise RuntimeError(f"waited in vain: {step}; {self._page.inner_text('main')[:300]}")


def visit(page: Page, address: str, clock: Clock) -> list[Image.Image]:
    """Every picture of a first visit, in order; what its steps took is noted."""
    visitor = Visitor(page, clock)
    page.goto(address)
    visitor.until("the phone page is there", lambda: page.is_visible("#simulated"))
    page.goto(f"{address.partition('/#')[0]}/desk.html")
    visitor.tap("[data-action=load-demonstration]")
    maps = page.locator("main a[href^='#/maps/']")
    visitor.until("the demonstration building is on the desk", lambda: maps.count() > 1)
    visitor.tap("main a[href^='#/maps/']")
    visitor.until("one of its floors is open", lambda: page.locator("main canvas").count() > 0)
    page.goto(address)
    visitor.tap("#simulated summary")
    visitor.tap("#simulate")
    grown = page.locator("#growing-said", has_text="confirmed by loops")
    visitor.until("a walk closes its loops", lambda: grown.count() > 0)
    visitor.until("the walk has come", lambda: page.is_visible("#finish"))
    visitor.until("its map is made", lambda: page.is_visible("#see-map"))
    visitor.tap("#another")
    visitor.tap("#where")
    visitor.tap("li:has-text('imulated') >> text=Get this map")
    visitor.tap("text=Find me here")
    found = page.locator("#place-status", has_text="Here, within")
    visitor.until("somebody else is found in it", lambda: found.count() > 0)
    visitor.until("they have walked on", lambda: page.is_visible("#problem"))
    return visitor.pictures


def save(pictures: list[Image.Image], file: Path) -> None:
    """The pictures as a film, those that stay the same only once."""
    first, *rest = pictures
    first.save(file, save_all=True, append_images=rest, duration=EVERY_MS, loop=0, optimize=True)


@contextmanager
def cloned(folder: Path, clock: Clock) -> Iterator[str]:
    """The address of a server of a fresh clone, installed as `make serve` does."""
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(folder)], check=True)
    clock.ends("git clone")
    subprocess.run(["make", "--silent", "-C", str(folder), *INSTALLED], check=True)
    clock.ends("make serve: installed")
    program = (str(folder / ".venv" / "bin" / "elfslam"), *COMMAND[3:])
    with serving(folder / "data", program=program) as address:
        clock.ends("make serve: the server answers")
        yield address


def main() -> None:
    """Make the film anew, and print what the visit took."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--clone", action="store_true", help="begin with git clone")
    fresh: bool = parser.parse_args().clone
    clock = Clock()
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        server = cloned(folder / "clone", clock) if fresh else serving(folder / "data")
        with server as address:
            browser: Any = playwright.chromium.launch(
                executable_path=CHROMIUM, args=["--no-sandbox"]
            )
            page = browser.new_page(viewport=PHONE, reduced_motion="reduce")
            save(visit(page, address, clock), FILM)
            browser.close()
    print_rows(clock.rows, title="The first minute", as_json=False)
    print(f"{FILM.relative_to(ROOT)}: {FILM.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

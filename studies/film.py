"""A film of the phone page and the desk: a simulated walk, its map, and somebody found in it.

    python -m studies.film

A real server and a real browser (chromium) make `docs/phone/film.gif`, in about a minute.
"""

from __future__ import annotations

import io
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from studies.benchmarks.browser_walk import CHROMIUM
from studies.benchmarks.served import serving

FILM = Path(__file__).parents[1] / "docs" / "phone" / "film.gif"
PHONE, WIDTH_PX = {"width": 390, "height": 760}, 300
EVERY_MS, COLOURS = 500, 48
HOLD = 3
"""Pictures for which something to read stays."""


class Camera:
    """Takes pictures of a page until something has happened."""

    def __init__(self, page: Page) -> None:
        self._page = page
        self.pictures: list[Image.Image] = []

    def take(self, count: int = HOLD) -> None:
        """The page as it is, for so many pictures; nobody watches one for longer."""
        shot = Image.open(io.BytesIO(self._page.screenshot())).convert("RGB")
        size = (WIDTH_PX, round(shot.height * WIDTH_PX / shot.width))
        small = shot.resize(size, Image.Resampling.LANCZOS)
        picture = small.quantize(COLOURS, dither=Image.Dither.NONE)
        same = [each for each in self.pictures[-HOLD:] if each.tobytes() == picture.tobytes()]
        self.pictures += (count - len(same)) * [picture]

    def until(self, happened: Callable[[], bool], most: int = 240) -> None:
        """A picture every half second. Raises RuntimeError where it never happens."""
        for _ in range(most):
            self.take(1)
            if happened():
                return
            self._page.wait_for_timeout(EVERY_MS)
        raise RuntimeError(f"the film waited in vain: {self._page.inner_text('main')[:300]}")


def play(page: Page, address: str) -> list[Image.Image]:
    """Every picture of the film, in order."""
    camera = Camera(page)
    page.goto(address)
    page.click("#simulated summary")
    page.locator("#simulate").scroll_into_view_if_needed()
    camera.take()
    page.click("#simulate")
    camera.until(lambda: page.is_visible("#finish"))
    camera.until(lambda: page.is_visible("#see-map"))
    camera.take()
    page.click("#another")
    page.click("#where")
    page.click("text=Get this map")
    camera.take()
    page.click("text=Find me here")
    camera.until(lambda: page.is_visible("#problem"))
    camera.take()
    return camera.pictures


def save(pictures: list[Image.Image], file: Path) -> None:
    """The pictures as a film, those that stay the same only once."""
    first, *rest = pictures
    first.save(file, save_all=True, append_images=rest, duration=EVERY_MS, loop=0, optimize=True)


def main() -> None:
    """Make the film anew."""
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder) / "data") as address,
        sync_playwright() as playwright,
    ):
        browser: Any = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport=PHONE, reduced_motion="reduce")
        save(play(page, address), FILM)
        browser.close()
    print(f"{FILM}: {FILM.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()

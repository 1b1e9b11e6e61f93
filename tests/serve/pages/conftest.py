"""Chromium for the tests of pages."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")
PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def play() -> Iterator[Any]:
    """What starts browsers; stopped with the file, as others start their own."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("chromium is missing: apt-get install chromium")
    with playwright.sync_playwright() as started:
        yield started


@pytest.fixture(scope="module")
def browser(play: Any) -> Iterator[Any]:
    """Chromium without a window."""
    started = play.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
    yield started
    started.close()


@dataclass
class Pocket:
    """A phone that is switched off and on and keeps what it keeps."""

    play: Any
    profile: Path
    options: dict[str, Any] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    """What its pages throw."""

    @contextmanager
    def on(self) -> Iterator[Any]:
        """Its browser; gives the page."""
        context = self.play.chromium.launch_persistent_context(
            str(self.profile), **{"executable_path": CHROMIUM, "viewport": PHONE, **self.options}
        )
        page = context.pages[0]
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        try:
            yield page
        finally:
            context.close()

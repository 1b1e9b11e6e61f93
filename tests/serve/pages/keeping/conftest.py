"""A phone's browser that is closed and opened again."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

CHROMIUM = shutil.which("chromium")
ARGUMENTS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking")


@dataclass
class Browser:
    """A phone's browser with a profile that lasts; whatever its pages throw fails the test."""

    profile: Path
    play: Any
    problems: list[str] = field(default_factory=list)

    @contextmanager
    def opened(self) -> Iterator[Any]:
        """The browser from its start to its end; gives a page."""
        context = self.play.chromium.launch_persistent_context(
            str(self.profile),
            executable_path=CHROMIUM,
            args=list(ARGUMENTS),
            viewport={"width": 390, "height": 844},
            bypass_csp=True,  # tests evaluate; that the policy holds is tested with the pages
        )
        page = context.new_page()
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        try:
            yield page
        finally:
            context.close()


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Browser]:
    """A phone that was just handed over."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("chromium is missing: apt-get install chromium")
    with playwright.sync_playwright() as play:
        handed = Browser(tmp_path / "profile", play)
        yield handed
    assert handed.problems == []

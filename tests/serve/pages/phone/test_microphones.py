"""Several microphones in a real browser: the page keeps the one that hears most of the echoes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from studies.benchmarks.acoustic_loop import FRAME, RATE_HZ, in_time, pulse_audio, room_between

pytestmark = pytest.mark.real

DIRECT, ECHOES = 0.3, ((0.004, 0.05), (0.0125, 0.06), (0.019, 0.04), (0.028, 0.03))


def response() -> np.ndarray:
    """A room of a direct sound and four echoes, as a transfer function (1, FRAME / 2 + 1)."""
    impulses = np.zeros(FRAME)
    impulses[0] = DIRECT
    for delay_s, gain in ECHOES:
        impulses[round(delay_s * RATE_HZ)] = gain
    return np.fft.rfft(impulses)[None]


@pytest.fixture
def phone_with(
    benchmark: Callable[[str], Any], server: Any, tmp_path: Path
) -> Callable[[Mapping[str, float]], Any]:
    """The page in a browser whose microphones hear a room by these gains; the first is its own."""
    browsing = benchmark("browser_walk").browsing
    room = response()

    @contextmanager
    def opened(microphones: Mapping[str, float]) -> Iterator[Any]:
        with (
            in_time(),
            pulse_audio(tmp_path, microphones) as environment,
            room_between(environment, room, tmp_path, microphones=microphones),
            browsing(environment) as browser,
        ):
            page = browser.new_context(permissions=["microphone"]).new_page()
            page.goto(server.address)
            yield page

    return opened


def check(page: Any, tap: str = "#allow") -> tuple[str, dict[str, str]]:
    """The microphone that listens, and what the check says of each."""
    page.click(tap)
    return checked(page)


def checked(page: Any) -> tuple[str, dict[str, str]]:
    page.wait_for_selector("#checks li:visible", timeout=60_000)
    listed = page.locator("#microphone option")
    told = dict(listed.nth(k).text_content().split(" · ") for k in range(listed.count()))
    return page.locator("#microphone option:checked").text_content().split(" · ")[0], told


def level_db(told: str) -> int:
    return int(told.removesuffix(" dB"))


def test_the_one_that_hears_the_chirps_20_db_better_is_taken_and_kept(phone_with: Any) -> None:
    with phone_with({"Front": 0.1, "Back": 1.0, "Headset": 0.0}) as page:
        chosen, told = check(page)
        assert chosen == "Back"
        assert set(told) == {"Default", "Front", "Back", "Headset"}
        assert told["Headset"] == "not heard"
        assert 12 < level_db(told["Back"]) - level_db(told["Front"]) < 28
        assert page.locator("#checks li").nth(2).get_attribute("data-verdict") == "pass"
        page.reload()
        assert check(page) == ("Back", told)
        page.select_option("#microphone", label=f"Front · {told['Front']}")
        page.wait_for_selector("#checks li", state="hidden")
        assert checked(page) == ("Front", told)
        page.reload()
        assert check(page) == ("Front", told)


def test_the_browsers_own_stays_where_no_other_hears_more(phone_with: Any) -> None:
    with phone_with({"Bottom": 1.0, "Camera": 1.0, "Headset": 0.0}) as page:
        assert check(page)[0] == "Default"

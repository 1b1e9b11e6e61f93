"""A recording along its time at the desk: what it lacks, and a stretch that is mapped again."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.real

Open = Callable[..., Any]
FACTS = {
    "duration_s": 60.0,
    "spans_s": {"sound": [[0.7, 40.0], [43.0, 59.0]], "motion": [[0.0, 60.0]]},
}
MISSING = [{"what": "sound", "from_s": 40.0, "until_s": 43.0}]


@pytest.fixture
def recording(person: Any, walk_folder: Path) -> str:
    return str(person.plant_recording("round the hall", walk_folder, facts=FACTS))


def move(page: Any, end: str, value: str) -> None:
    """As a hand moves one end of the time line."""
    slider = page.get_by_role("slider", name=end)
    slider.evaluate("(input, value) => { input.value = value; }", value)
    slider.dispatch_event("input")


def given(asked: Any, page: Any) -> dict[str, Any]:
    return dict(asked(page, "/api/jobs")[0]["given"])


def test_all_of_a_recording_is_mapped_where_nothing_is_moved(
    person: Any, open_desk: Open, recording: str, asked: Any
) -> None:
    page = open_desk(person, "#/recordings")
    page.get_by_role("button", name="Map round the hall").click()
    page.get_by_role("dialog").get_by_role("button", name="Map it").click()
    page.get_by_text("is waiting to be mapped").wait_for()
    told = given(asked, page)
    assert (told["recording"], told["from_s"], told["until_s"]) == (recording, None, None)


def test_a_stretch_is_chosen_on_a_time_line(
    person: Any, open_desk: Open, recording: str, asked: Any
) -> None:
    page = open_desk(person, "#/recordings")
    page.get_by_role("button", name="Map round the hall").click()
    dialog = page.get_by_role("dialog")
    sound = dialog.get_by_role("img", name="Sound: 0:00.7 to 0:40.0, 0:43.0 to 0:59.0")
    assert sound.count() == 1
    assert dialog.get_by_role("img", name="Motion: 0:00.0 to 1:00.0").count() == 1
    move(page, "From", "12.5")
    move(page, "Until", "45")
    assert "0:12.5" in dialog.inner_text()
    assert "0:45.0" in dialog.inner_text()
    dialog.get_by_role("button", name="Map it").click()
    page.get_by_text("is waiting to be mapped").wait_for()
    told = given(asked, page)
    assert (told["recording"], told["from_s"], told["until_s"]) == (recording, 12.5, 45.0)


def test_the_ends_are_moved_by_keys_and_never_cross(
    person: Any, open_desk: Open, recording: str
) -> None:
    page = open_desk(person, "#/recordings")
    page.get_by_role("button", name="Map round the hall").click()
    begin, end = (page.get_by_role("slider", name=name) for name in ("From", "Until"))
    begin.focus()
    page.keyboard.press("ArrowRight")
    assert begin.input_value() == "0.1"
    assert begin.get_attribute("aria-valuetext") == "0:00.1"
    page.keyboard.press("End")
    assert (begin.input_value(), end.input_value()) == ("58", "60")
    end.focus()
    page.keyboard.press("Home")
    assert (begin.input_value(), end.input_value()) == ("0", "2")


def test_a_map_says_what_is_missing_and_is_made_again_of_a_stretch(
    person: Any, open_desk: Open, recording: str, run_folder: Path, asked: Any
) -> None:
    facts = {"missing": MISSING, "kept_s": [5.0, 1e6], "footsteps": 9}
    made = person.plant_map("round the hall", run_folder, facts=facts, sources=[recording])
    page = open_desk(person, f"#/maps/{made}")
    part = page.get_by_role("region", name="Recording")
    part.get_by_text("Sound is missing from 0:40.0 to 0:43.0").wait_for()
    part.get_by_text("Mapped from 0:05.0 to the end.").wait_for()
    part.get_by_role("button", name="Trim and map again").click()
    assert page.get_by_role("slider", name="From").input_value() == "5"
    move(page, "Until", "39.9")
    page.get_by_role("dialog").get_by_role("button", name="Map it").click()
    page.get_by_text("Another map of round the hall is being made; this one stays.").wait_for()
    told = given(asked, page)
    assert (told["from_s"], told["until_s"]) == (5.0, 39.9)
    page.evaluate("() => { location.hash = '#/maps'; }")
    page.get_by_text("of a stretch of the recording").wait_for()


def test_of_a_recording_that_is_gone_only_what_was_missing_is_told(
    person: Any, open_desk: Open, run_folder: Path
) -> None:
    made = person.plant_map("round the hall", run_folder, facts={"missing": MISSING})
    page = open_desk(person, f"#/maps/{made}")
    page.get_by_text("Sound is missing from 0:40.0 to 0:43.0").wait_for()
    assert page.get_by_role("button", name="Trim and map again").count() == 0
    whole = person.plant_map("another", run_folder)
    page.evaluate("id => { location.hash = `#/maps/${id}`; }", whole)
    page.get_by_role("heading", name="another").wait_for()
    assert page.get_by_role("region", name="Recording").count() == 0


@pytest.mark.parametrize("width_px", [320, 390, 1280])
def test_the_time_line_fits(person: Any, open_desk: Open, recording: str, width_px: int) -> None:
    page = open_desk(person, "#/recordings", viewport={"width": width_px, "height": 800})
    page.get_by_role("button", name="Map round the hall").click()
    dialog = page.get_by_role("dialog")
    assert dialog.evaluate("(element) => element.scrollWidth - element.clientWidth") <= 0
    for name in ("From", "Until"):
        box = page.get_by_role("slider", name=name).bounding_box()
        assert box is not None
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= width_px

"""Rooms and doors named on the desk, in a real browser against a real server."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tests.serve.pages.desk.test_map import (
    Open,
    drawn,
    layer,
    opened,
    pixels,
    px_per_m,
    tapped,
    xy_of,
)

pytestmark = pytest.mark.real


@pytest.fixture
def map_id(person: Any, looped_folder: Path) -> str:
    """A planted map of one walk."""
    return str(person.plant_map("round the studio", looped_folder))


def points_of(page: Any, asked: Any, map_id: str) -> list[dict[str, Any]]:
    return list(asked(page, f"/api/maps/{map_id}/points-of-interest")["points"])


def name_it(page: Any, name: str, kind: str) -> None:
    page.get_by_label("Name", exact=True).fill(name)
    page.get_by_label("Kind").select_option(label=kind)
    page.get_by_role("dialog").get_by_role("button", name="Save").click()
    page.locator(".points li", has_text=name).wait_for()


def test_a_place_is_named_by_a_tap_changed_and_forgotten(
    person: Any, open_desk: Open, map_id: str, asked: Any, run_folder: Path
) -> None:
    page = opened(open_desk(person), map_id)
    there = xy_of(run_folder)[10]
    before = pixels(page)
    page.get_by_role("button", name="Name a place").click()
    tapped(page, run_folder, tuple(there))
    name_it(page, "Room 5", "room")
    (kept,) = points_of(page, asked, map_id)
    assert (kept["name"], kept["kind"]) == ("Room 5", "room")
    near = 2 / px_per_m(page)
    assert [kept["x_m"], kept["y_m"]] == pytest.approx(there.tolist(), abs=near)
    drawn(page)
    assert (pixels(page) != before).any()
    layer(page, "Named places", on=False)
    layer(page, "Named places", on=True)
    page.get_by_role("button", name="Change Room 5").click()
    page.get_by_label("x, m").fill("1.25")
    name_it(page, "Lift", "lift")
    (kept,) = points_of(page, asked, map_id)
    assert (kept["name"], kept["kind"], kept["x_m"]) == ("Lift", "lift", 1.25)
    page.get_by_role("button", name="Delete Lift").click()
    page.get_by_role("button", name="Delete for good").click()
    page.get_by_text("Rooms, doors and lifts get a name here").wait_for()
    assert points_of(page, asked, map_id) == []


def test_a_place_is_named_by_the_keyboard_alone(
    person: Any, open_desk: Open, map_id: str, asked: Any
) -> None:
    page = opened(open_desk(person), map_id)
    page.get_by_role("button", name="Name a place").press("Enter")
    page.get_by_role("button", name="Type where it is").press("Enter")
    page.get_by_label("x, m").fill("-2")
    page.get_by_label("y, m").fill("3.5")
    name_it(page, "Stairs <b>down</b>", "stairs")
    (kept,) = points_of(page, asked, map_id)
    assert (kept["name"], kept["x_m"], kept["y_m"]) == ("Stairs <b>down</b>", -2.0, 3.5)


def test_what_somebody_else_named_meanwhile_is_shown_and_kept(
    person: Any, open_desk: Open, map_id: str, asked: Any
) -> None:
    page = opened(open_desk(person), map_id)
    page.get_by_text("Rooms, doors and lifts get a name here").wait_for()
    theirs = {"name": "Their door", "kind": "door", "x_m": 0.0, "y_m": 0.0}
    answer = page.context.request.put(
        f"{person.origin}/api/maps/{map_id}/points-of-interest",
        data={"version": "", "points": [theirs]},
        headers={"Authorization": f"Bearer {person.token}"},
    )
    assert answer.ok
    page.get_by_role("button", name="Name a place").click()
    page.get_by_role("button", name="Type where it is").click()
    page.get_by_label("Name", exact=True).fill("Mine")
    page.get_by_role("dialog").get_by_role("button", name="Save").click()
    page.get_by_text("somebody else changed these places meanwhile").wait_for()
    page.locator(".points li", has_text="Their door").wait_for()
    assert points_of(page, asked, map_id) == [theirs]
    person.problems.clear()

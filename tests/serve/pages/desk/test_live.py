"""Walkers who let others see where they are, on the desk's map."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest

Open = Callable[..., Any]
WALK = "0123456789abcdef"


@pytest.fixture
def map_id(person: Any, run_folder: Path) -> str:
    return str(person.plant_map("round the studio", run_folder))


@pytest.fixture
def tell(person: Any, map_id: str) -> Callable[..., int]:
    """What a phone of the same person sends; gives the status of the answer."""

    def told(*fixes: dict[str, Any], **more: Any) -> int:
        answer = httpx.post(
            f"{person.origin}/api/positions",
            json={"map": map_id, "walk": WALK, "positions": list(fixes), **more},
            headers={"Authorization": f"Bearer {person.token}"},
            timeout=60,
        )
        return answer.status_code

    return told


def opened(page: Any, map_id: str) -> Any:
    page.evaluate("id => { location.hash = `#/maps/${id}`; }", map_id)
    page.get_by_text("Nobody at this moment").wait_for()
    return page


HERE = {"status": "OK", "x_m": 1.0, "y_m": 1.0, "heading_rad": 0.0, "sigma_m": 0.4}


def picture(page: Any) -> str:
    page.evaluate("new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")
    return str(page.evaluate("document.querySelector('.stage canvas').toDataURL()"))


def test_a_walker_comes_moves_and_goes(
    person: Any, open_desk: Open, map_id: str, tell: Callable[..., int]
) -> None:
    page = opened(open_desk(person), map_id)
    row = page.locator(".live li")
    empty = picture(page)
    assert tell(HERE) == 204
    row.get_by_text("Ada").wait_for()
    assert "located" in row.inner_text()
    there = picture(page)
    assert there != empty
    assert tell({**HERE, "status": "AMBIGUOUS", "x_m": 2.0}) == 204
    row.get_by_text("several places sound alike").wait_for()
    assert picture(page) not in (there, empty)
    assert row.count() == 1
    assert tell(is_over=True) == 204
    page.get_by_text("Nobody at this moment").wait_for()
    assert picture(page) == empty


def test_who_was_there_before_is_shown_and_the_owner_may_switch_it_off(
    person: Any, open_desk: Open, map_id: str, tell: Callable[..., int], asked: Any
) -> None:
    assert tell(HERE) == 204
    page = open_desk(person)
    page.evaluate("id => { location.hash = `#/maps/${id}`; }", map_id)
    switch = page.get_by_role("switch", name="Take and show live positions")
    page.locator(".live li", has_text="Ada").wait_for()
    assert switch.is_checked()
    switch.uncheck()
    page.get_by_text("Nobody's position is taken for this map").wait_for()
    assert asked(page, f"/api/maps/{map_id}/positions/settings")["is_on"] is False
    assert tell(HERE) == 409
    switch.check()
    page.get_by_text("Nobody at this moment").wait_for()
    assert tell(HERE) == 204
    page.locator(".live li", has_text="Ada").wait_for()

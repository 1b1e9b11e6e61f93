"""That everybody can use the desk page: names, contrast, keys, narrow screens, no jumps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.store.database import JobKind, JobState

Open = Callable[..., Any]
ACTIVE = "document.activeElement"
PAGES = ("#/recordings", "#/jobs", "#/maps", "map", "recording")

HERE = Path(__file__).parent
NAMELESS = (HERE / "nameless.js").read_text()
FAINT = (HERE / "faint.js").read_text()


@pytest.fixture
def full(person: Any, run_folder: Path, walk_folder: Path) -> Any:
    """Somebody with one of everything."""
    person.recording = person.plant_recording("round the studio", walk_folder)
    given = {"recording": person.recording}
    person.map_id = person.plant_map("round the studio", run_folder)
    person.plant_map("a second map with quite a long name of its own", run_folder)
    person.plant_job(JobKind.MAP, JobState.QUEUED, given=given)
    person.plant_job(JobKind.MAP, JobState.DONE, given=given, gave={"map": person.map_id})
    why = "no loop was closed: 61 footsteps never come back to where they were"
    person.plant_job(JobKind.MAP, JobState.FAILED, given=given, problem=why)
    return person


def visit(page: Any, person: Any, where: str) -> None:
    things = {"map": f"#/maps/{person.map_id}", "recording": f"#/recordings/{person.recording}"}
    fragment = things.get(where, where)
    page.evaluate("fragment => { location.hash = fragment; }", fragment)
    waited = {"map": ".exports li", "recording": "figure.plot"}
    page.wait_for_selector(waited.get(where, "table.list"))


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everything_has_a_name_and_can_be_read(full: Any, open_desk: Open, scheme: str) -> None:
    page = open_desk(full, color_scheme=scheme, reduced_motion="reduce")
    for where in PAGES:
        visit(page, full, where)
        assert page.evaluate(NAMELESS) == [], where
        assert page.evaluate(FAINT) == [], where


def test_what_is_nameless_and_faint_is_noticed(full: Any, open_desk: Open) -> None:
    page = open_desk(full)
    page.evaluate(
        """() => {
          const faint = Object.assign(document.createElement("p"), { textContent: "hardly there" });
          faint.style.color = "#bbb";
          document.querySelector("main").append(document.createElement("button"), faint);
        }"""
    )
    assert len(page.evaluate(NAMELESS)) == 1
    assert any("hardly there" in each for each in page.evaluate(FAINT))


@pytest.mark.parametrize("width", [320, 700, 1024])
def test_nothing_lies_beside_the_screen(full: Any, open_desk: Open, width: int) -> None:
    page = open_desk(full, viewport={"width": width, "height": 700})
    for where in PAGES:
        visit(page, full, where)
        assert page.evaluate("document.documentElement.scrollWidth") <= width, where


def test_headings_are_in_order_and_there_is_one_first(full: Any, open_desk: Open) -> None:
    page = open_desk(full)
    for where in PAGES:
        visit(page, full, where)
        levels = page.evaluate(
            "[...document.querySelectorAll('h1, h2, h3')].map((each) => Number(each.tagName[1]))"
        )
        assert levels.count(1) == 1, where
        assert levels[0] == 1, where


def test_a_table_stays_a_table_where_it_is_laid_out_as_cards(full: Any, open_desk: Open) -> None:
    page = open_desk(full, viewport={"width": 360, "height": 700})
    visit(page, full, "#/maps")
    assert page.get_by_role("table", name="Maps").count() == 1
    assert page.get_by_role("rowheader").count() == 2
    assert page.get_by_role("columnheader", name="Length").count() == 1


def test_the_desk_is_used_by_keyboard_alone(full: Any, open_desk: Open) -> None:
    page = open_desk(full)
    visit(page, full, "#/maps")
    page.get_by_role("link", name="Maps").focus()
    names = []
    for _ in range(16):
        page.keyboard.press("Tab")
        names.append(page.evaluate(f"{ACTIVE}.getAttribute('aria-label') ?? {ACTIVE}.textContent"))
    for wanted in (
        "Choose round the studio",
        "Report of round the studio",
        "Delete round the studio",
    ):
        assert wanted in names
    page.get_by_role("button", name="Delete round the studio").press("Enter")
    assert page.evaluate("document.activeElement.textContent") == "Keep it", (
        "the harmless one first"
    )
    page.keyboard.press("Escape")
    assert page.get_by_role("dialog").count() == 0


def test_nothing_jumps_while_the_page_is_kept_fresh(full: Any, open_desk: Open) -> None:
    page = open_desk(full)
    visit(page, full, "#/jobs")
    page.wait_for_timeout(500)
    page.evaluate(
        """() => {
          window.moved = 0;
          const add = (list) => list.getEntries().forEach((e) => { window.moved += e.value; });
          new PerformanceObserver(add).observe({ type: "layout-shift", buffered: false });
          window.first = document.querySelector("tbody tr");
        }"""
    )
    page.wait_for_timeout(3500)
    assert page.evaluate("window.moved") < 0.01
    assert page.evaluate("window.first === document.querySelector('tbody tr')"), "rows are kept"

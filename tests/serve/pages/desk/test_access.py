"""That everybody can use the desk page: names, contrast, keys, narrow screens, no jumps."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.store.database import transaction
from elfslam.serve.store.tables import JobKind, JobState, MapLink, MapShare
from tests.accessibility import violations
from tests.serve.pages.desk.conftest import Person, go
from tests.untranslated import clipped, left_in_english

ACTIVE = "document.activeElement"
PAGES = ("#/recordings", "#/jobs", "#/maps", "map", "shared map", "recording")
DIALOGS = {
    "en": {
        "Share round the studio": "Share round the studio",
        "Rename round the studio": "Name and place",
        "Rename Annex": "",
        "Take a third off my list": "Take a third off your list?",
        "Delete 2": "Delete 2 maps?",
    },
    "de": {
        "round the studio teilen": "round the studio teilen",
        "round the studio umbenennen": "Name und Ort",
        "a third von meiner Liste nehmen": "a third von deiner Liste nehmen?",
        "2 löschen": "2 Karten löschen?",
        "2 Karten zusammenfügen": "2 Karten zusammenfügen",
    },
}
"""Buttons of the list of maps, and what they ask; nothing where the button is not there."""
SECRET = "a" * 22

HERE = Path(__file__).parent
SMALL = (HERE / "small.js").read_text()


@pytest.fixture
def full(ada: Person, invite: Any, run_folder: Path) -> Any:
    """Somebody with one of everything, and with whom something is shared."""
    ada.recording = ada.plant_recording("round the studio")
    given = {"recording": ada.recording}
    ada.map_id = ada.plant_map("round the studio")
    ada.plant_map(
        "a second map with quite a long name of its own",
        run_folder,
        venue="A venue that is called something long as well",
        floor="Basement",
    )
    ada.plant_recording("round it once more")
    other = invite("Somebody Else of a Long Name")
    ada.shared_id = other.plant_map("a third", venue="Annex", floor="Floor 2")
    with transaction(ada.services.sessions) as session:
        session.add(MapShare(map_id=ada.shared_id, user_id=ada.id, may="read"))
        session.add(MapShare(map_id=ada.map_id, user_id=other.id, may="edit"))
        session.add(MapLink(map_id=ada.map_id, secret=SECRET, may="read"))
    ada.plant_job(JobKind.MAP, JobState.QUEUED, given=given)
    ada.plant_job(JobKind.MAP, JobState.DONE, given=given, gave={"map": ada.map_id})
    why = "no loop was closed: 61 footsteps never come back to where they were"
    ada.plant_job(JobKind.MAP, JobState.FAILED, given=given, problem=why)
    return ada


def visit(page: Any, ada: Person, where: str) -> None:
    maps = {"map": ada.map_id, "shared map": ada.shared_id}
    things = {name: f"#/maps/{map_id}" for name, map_id in maps.items()}
    things["recording"] = f"#/recordings/{ada.recording}"
    go(page, things.get(where, where))
    if where in maps:
        name = {"map": "round the studio", "shared map": "a third"}[where]
        page.get_by_role("heading", name=name, level=1).wait_for()
        page.wait_for_selector(".exports li")
    else:
        page.wait_for_selector("figure.plot" if where == "recording" else "table.list")


def shown_otherwise(page: Any, widths: tuple[int, ...]) -> Iterator[int]:
    """The page as it is, by day and by night on screens of these widths."""
    for width in widths:
        page.set_viewport_size({"width": width, "height": 700})
        for scheme in ("dark", "light"):
            page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
            yield width


def is_wider(page: Any, width: int) -> bool:
    return bool(page.evaluate("document.documentElement.scrollWidth") > width)


def test_everything_has_a_name_and_can_be_read_and_fits(full: Any) -> None:
    page = full.open()
    for where in PAGES:
        visit(page, full, where)
        for width in (320, 700, 1024):
            page.set_viewport_size({"width": width, "height": 700})
            assert not is_wider(page, width), (where, width)
        for width in shown_otherwise(page, (1280,)):
            assert violations(page) == [], (where, width)
        assert page.evaluate(SMALL) == [], where
        levels = page.evaluate(
            "[...document.querySelectorAll('h1, h2, h3')].map((each) => Number(each.tagName[1]))"
        )
        assert levels.count(1) == 1, where
        assert levels[0] == 1, where


@pytest.mark.parametrize("language", DIALOGS)
def test_what_is_asked_has_names_can_be_read_and_fits(full: Any, language: str) -> None:
    size = {"width": 320, "height": 640}
    page = full.open(locale=language, reduced_motion="reduce", viewport=size)
    visit(page, full, "#/maps")
    choose = {"en": "Choose {}", "de": "{} wählen"}[language]
    for each in ("round the studio", "a second map with quite a long name of its own"):
        page.get_by_label(choose.format(each)).check()
    for button, title in DIALOGS[language].items():
        if not title:
            assert page.get_by_role("button", name=button, exact=True).count() == 0, button
            continue
        page.get_by_role("button", name=button, exact=True).click()
        dialog = page.get_by_role("dialog", name=title)
        dialog.wait_for()
        for width in shown_otherwise(page, (320,)):
            assert violations(page) == [], button
            box = dialog.bounding_box()
            assert box["x"] >= 0, button
            assert box["x"] + box["width"] <= width, button
            assert not dialog.evaluate("each => each.scrollWidth > each.clientWidth"), button
        if language != "en":
            assert left_in_english(page, language) == [], button
            assert clipped(page) == [], button
        page.keyboard.press("Escape")
        dialog.wait_for(state="detached")


def test_what_a_guest_sees_has_names_can_be_read_and_fits(full: Any, fresh: Any) -> None:
    page = fresh()
    for address, heading in (
        (f"/desk#link={full.map_id}.{SECRET}", "round the studio"),
        ("/desk#link=none", "This link opens nothing"),
        ("/no/such/page", "There is no such page"),
    ):
        page.goto(f"{full.origin}{address}")
        page.get_by_role("heading", name=heading, level=1).wait_for()
        for width in shown_otherwise(page, (320, 1280)):
            assert violations(page) == [], address
            assert not is_wider(page, width), address


def test_what_is_nameless_and_faint_is_noticed(full: Any) -> None:
    page = full.open()
    page.evaluate(
        """() => {
          const faint = Object.assign(document.createElement("p"), { textContent: "hardly there" });
          faint.style.color = "#bbb";
          document.querySelector("header").append(document.createElement("button"), faint);
        }"""
    )
    found = violations(page)
    assert [each.split(":")[0] for each in found] == ["button-name", "color-contrast"]
    assert "hardly there" in found[1]


def test_a_table_stays_a_table_where_it_is_laid_out_as_cards(full: Any) -> None:
    page = full.open(viewport={"width": 360, "height": 700})
    visit(page, full, "#/maps")
    assert page.get_by_role("table", name="Maps").count() == 1
    headings = page.locator("tr.group")
    assert page.get_by_role("rowheader").count() == 3 + headings.count()
    assert page.get_by_role("columnheader", name="Length").count() == 1


def test_the_desk_is_used_by_keyboard_alone(full: Any) -> None:
    page = full.open()
    visit(page, full, "#/maps")
    page.get_by_role("link", name="Maps").focus()
    names = []
    for _ in range(48):
        page.keyboard.press("Tab")
        names.append(page.evaluate(f"{ACTIVE}.getAttribute('aria-label') ?? {ACTIVE}.textContent"))
    for wanted in (
        "Choose round the studio",
        "Report of round the studio",
        "Delete round the studio",
    ):
        assert wanted in names
    for wanted in ("Search maps", "Share round the studio", "Rename round the studio"):
        assert wanted in names
    page.get_by_role("button", name="Delete round the studio").press("Enter")
    assert page.evaluate("document.activeElement.textContent") == "Keep it", (
        "the harmless one first"
    )
    page.keyboard.press("Escape")
    assert page.get_by_role("dialog").count() == 0


def test_nothing_jumps_while_the_page_is_kept_fresh(full: Any) -> None:
    page = full.open()
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


def test_all_of_it_is_german_for_who_prefers_that(full: Any) -> None:
    page = full.open(locale="de-DE", reduced_motion="reduce")
    assert page.get_attribute("html", "lang") == "de"
    for where in PAGES:
        visit(page, full, where)
        for width in (320, 390, 1280):
            page.set_viewport_size({"width": width, "height": 700})
            assert left_in_english(page, "de") == [], (where, width)
            assert clipped(page) == [], (where, width)
            assert violations(page) == [], (where, width)
            assert not is_wider(page, width), (where, width)


def test_the_language_of_the_desk_is_chosen_and_stays(full: Any) -> None:
    page = full.open(locale="de-DE")
    page.get_by_role("heading", name="Aufnahmen", level=1).wait_for()
    page.get_by_label("Sprache").select_option("en")
    page.get_by_role("heading", name="Recordings", level=1).wait_for()
    page.reload()
    page.get_by_role("heading", name="Recordings", level=1).wait_for()
    assert page.get_by_label("Language").input_value() == "en"
    assert "Add recordings" in left_in_english(page, "de"), "English is noticed"
    page.goto(f"{full.origin}/")
    page.get_by_role("heading", name="Walk, and get a map").wait_for()


def test_who_comes_to_the_door_is_spoken_to_in_german(full: Any, fresh: Any) -> None:
    page = fresh(locale="de-AT", viewport={"width": 320, "height": 640})
    for address, heading in (
        ("/desk", "Dieser Browser ist nicht gekoppelt"),
        ("/desk#link=none", "Dieser Link öffnet nichts"),
        (f"/desk#link={full.map_id}.{SECRET}", "round the studio"),
    ):
        page.goto("about:blank")
        page.goto(f"{full.origin}{address}")
        page.get_by_role("heading", name=heading, level=1).wait_for()
        assert left_in_english(page, "de") == [], address
        assert page.evaluate("document.documentElement.scrollWidth") <= 320, address

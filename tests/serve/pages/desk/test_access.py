"""That everybody can use the desk page: names, contrast, keys, narrow screens, nothing that jumps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from elfslam.serve.database import JobKind, JobState

Open = Callable[..., Any]
PAGES = ("#/recordings", "#/jobs", "#/maps", "map")
LEAST_CONTRAST = 4.5
LARGE_CONTRAST = 3.0

NAMELESS = """() => {
  const wanted = "button, a[href], input, select, textarea, canvas, progress, table, dialog, [role=img]";
  const text = (element) => (element?.textContent ?? "").trim();
  const named = (element) => element.getAttribute("aria-label")
    || text(document.getElementById(element.getAttribute("aria-labelledby")))
    || [...(element.labels ?? [])].map(text).join("") || text(element) || element.title
    || (element.closest("table") === element && text(element.caption));
  return [...document.querySelectorAll(wanted)]
    .filter((element) => element.checkVisibility() && !named(element) && !element.closest(".walks, .meetings"))
    .map((element) => element.outerHTML.slice(0, 120));
}"""

FAINT = """() => {
  const canvas = document.createElement("canvas").getContext("2d", { willReadFrequently: true });
  const rgba = (colour) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = colour;
    canvas.fillRect(0, 0, 1, 1);
    return [...canvas.getImageData(0, 0, 1, 1).data];
  };
  const over = (top, below) => top.slice(0, 3).map((v, k) => (v * top[3] + below[k] * (255 - top[3])) / 255);
  const ground = (element) => {
    const layers = [];
    for (let at = element; at; at = at.parentElement) layers.push(rgba(getComputedStyle(at).backgroundColor));
    return layers.reverse().reduce((below, top) => over(top, below), rgba("Canvas").slice(0, 3));
  };
  const light = (rgb) => {
    const [r, g, b] = rgb.map((v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement;
    if (!node.textContent.trim() || !element.checkVisibility() || element.closest("canvas, :disabled, [aria-disabled=true], .visually-hidden, .skip, noscript, .drop-here")) continue;
    const style = getComputedStyle(element);
    const below = ground(element);
    const [low, high] = [light(over(rgba(style.color), below)), light(below)].sort((a, b) => a - b);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    const ratio = (high + 0.05) / (low + 0.05);
    if (ratio < (large ? LARGE : LEAST)) found.push(`${ratio.toFixed(2)} ${node.textContent.trim().slice(0, 40)}`);
  }
  return found;
}""".replace("LARGE", str(LARGE_CONTRAST)).replace("LEAST", str(LEAST_CONTRAST))


@pytest.fixture
def full(person: Any, run_folder: Path, walk_folder: Path) -> Any:
    """Somebody with one of everything."""
    recording = person.plant_recording("round the studio", walk_folder)
    given = {"recording": recording}
    person.map_id = person.plant_map("round the studio", run_folder)
    person.plant_map("a second map with quite a long name of its own", run_folder)
    person.plant_job(JobKind.MAP, JobState.QUEUED, given=given)
    person.plant_job(JobKind.MAP, JobState.DONE, given=given, gave={"map": person.map_id})
    why = "no loop was closed: 61 footsteps never come back to where they were"
    person.plant_job(JobKind.MAP, JobState.FAILED, given=given, problem=why)
    return person


def visit(page: Any, person: Any, where: str) -> None:
    fragment = f"#/maps/{person.map_id}" if where == "map" else where
    page.evaluate("fragment => { location.hash = fragment; }", fragment)
    page.wait_for_selector(".exports li" if where == "map" else "table.list")


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
        names.append(page.evaluate("document.activeElement.getAttribute('aria-label') ?? document.activeElement.textContent"))
    for wanted in ("Choose round the studio", "Report of round the studio", "Delete round the studio"):
        assert wanted in names
    page.get_by_role("button", name="Delete round the studio").press("Enter")
    assert page.evaluate("document.activeElement.textContent") == "Keep it", "the harmless one first"
    page.keyboard.press("Escape")
    assert page.get_by_role("dialog").count() == 0


def test_nothing_jumps_while_the_page_is_kept_fresh(full: Any, open_desk: Open) -> None:
    page = open_desk(full)
    visit(page, full, "#/jobs")
    page.wait_for_timeout(500)
    page.evaluate(
        """() => {
          window.moved = 0;
          new PerformanceObserver((list) => list.getEntries().forEach((e) => { window.moved += e.value; }))
            .observe({ type: "layout-shift", buffered: false });
          window.first = document.querySelector("tbody tr");
        }"""
    )
    page.wait_for_timeout(3500)
    assert page.evaluate("window.moved") < 0.01
    assert page.evaluate("window.first === document.querySelector('tbody tr')"), "rows are kept"

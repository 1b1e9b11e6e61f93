"""The table of localization errors, small: every way is there, and echoes beat the rivals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.scoring.page import save_page
from elfslam.world.kinds import SURVEYOR
from studies.finding import Finding, Given
from studies.localization import measure_localization
from studies.localization_table import localization_rows

LEAST_ANSWERED = {"one-shot": 0.6, "trajectory": 0.8, "track": 0.9}


@pytest.fixture(scope="module")
def finding() -> Finding:
    small = {"worlds": ("studio",), "seeds": (100,), "mapping_rounds": 2, "rounds": 1}
    return measure_localization(Given(), kind=SURVEYOR, **small)


def median_m(finding: Finding, method: str, mode: str) -> float:
    (row,) = [row for row in finding.rows if (row["method"], row["mode"]) == (method, mode)]
    return float(str(row["error (m)"]).split(" / ")[0])


def test_every_way_has_a_row(finding: Finding) -> None:
    ways = {(row["method"], row["mode"]) for row in finding.rows}
    assert {("ELF", mode) for mode in ("one-shot", "trajectory", "track")} <= ways
    for rival in ("wifi", "wifi, paper's", "magnetic", "magnetic, paper's"):
        assert {(rival, "one-shot"), (rival, "trajectory")} <= ways


def test_echoes_find_the_place_to_decimetres_and_wifi_does_not(finding: Finding) -> None:
    for mode in ("one-shot", "trajectory", "track"):
        assert median_m(finding, "ELF", mode) < 0.3
    assert median_m(finding, "wifi", "one-shot") > 2 * median_m(finding, "ELF", "one-shot")


def test_answers_are_counted_here_and_in_another_room(finding: Finding) -> None:
    for row in finding.rows:
        if row["method"] == "ELF":
            assert float(str(row["answered"])) > LEAST_ANSWERED[row["mode"]]
            assert float(str(row["answered elsewhere"])) < 0.15
        else:
            assert row["answered"] == 1.0
            assert row["answered elsewhere"] is None


def test_a_walk_without_answers_counts_for_no_error() -> None:
    some = {"ELF|track|median": 0.2, "ELF|track|mean": 0.3, "ELF|track|Q3": 0.4}
    none = dict.fromkeys(some, float("nan"))
    (row,) = localization_rows(
        {"room": [{**some, "ELF|track|answered": 1.0}, {**none, "ELF|track|answered": 0.0}]}
    )
    assert row["error (m)"] == "0.20 / 0.30 / 0.40"
    assert row["answered"] == 0.5
    (row,) = localization_rows({"room": [{**none, "ELF|track|answered": 0.0}]})
    assert row["error (m)"] is None
    assert row["median from"] is None


def test_the_page_has_a_figure_for_each_mode(finding: Finding, tmp_path: Path) -> None:
    assert finding.page is not None
    save_page(tmp_path / "page.html", finding.page)
    titles = [panel.title for panel in finding.page.panels]
    assert titles == ["From 0.6 s of sound", "From footsteps and sound", "Median / mean / Q3"]
    names = {name for trace in finding.page.panels[1].body.data for name in trace.y}  # type: ignore[union-attr]
    assert {"ELF", "ELF, tracker", "wifi"} <= names
    assert np.isfinite(median_m(finding, "ELF", "track"))

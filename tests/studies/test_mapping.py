"""The table of mapping errors, small: every method is there, and echoes help."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from elfslam.app.settings import Settings
from elfslam.learn.parameters import ScratchParameters
from elfslam.scoring.page import save_page
from studies import mapping
from studies.finding import Finding, Given
from studies.mapping import CALIBRATED, UNCALIBRATED, measure_mapping, walkers


@pytest.fixture(scope="module")
def finding() -> Iterator[Finding]:
    known = ScratchParameters(steps=2, pairs=16, threads=1)
    quiet = {"worlds": ("studio",), "seeds": (100,), "rounds": 2, "scratch": known}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mapping_errors, "CURATED_SEEDS", 101)
        yield measure_mapping(Given(), **quiet)


def error_m(finding: Finding, method: str) -> float:
    (row,) = [row for row in finding.rows if (row["method"], row["walker"]) == (method, CALIBRATED)]
    return float(str(row["aligned (m)"]).split(" / ")[0])


def test_every_method_has_a_row_for_each_walker(finding: Finding) -> None:
    methods = [row["method"] for row in finding.rows if row["walker"] == CALIBRATED]
    off = [row["method"] for row in finding.rows if row["walker"] == UNCALIBRATED]
    assert [method for method in methods if "paper's" not in str(method)] == off
    assert {"ELF, paper's curation", "wifi, paper's", "magnetic, paper's"} <= set(methods)
    assert {"dead reckoning", "ELF", "wifi", "magnetic", "emr", "all together"} <= set(methods)


def test_echoes_straighten_the_walk(finding: Finding) -> None:
    assert error_m(finding, "ELF") < 0.8 * error_m(finding, "dead reckoning")


def test_walkers_differ_by_what_is_known_of_their_steps() -> None:
    for seed, sign in ((4, 1), (5, -1)):
        known = walkers(seed)
        ratio = known[UNCALIBRATED].motion.step_scale / known[CALIBRATED].motion.step_scale
        assert ratio == pytest.approx(1 + 0.1 * sign)
    assert known[CALIBRATED].motion.step_scale_sigma < Settings().motion.step_scale_sigma


def test_the_page_shows_a_figure_for_each_walker(finding: Finding, tmp_path: Path) -> None:
    assert finding.page is not None
    save_page(tmp_path / "page.html", finding.page)
    assert [panel.title for panel in finding.page.panels][:2] == [
        f"Mapping error, walkers {walker}" for walker in (CALIBRATED, UNCALIBRATED)
    ]

"""Closures step by step, on one small walk."""

from __future__ import annotations

from pathlib import Path

import pytest

from elfslam.scoring.page import save_page
from elfslam.world.kinds import QUIET
from studies.closure_steps import PAPER, SEQUENCE, SINGLE, measure_closure_steps
from studies.finding import Finding, Given


@pytest.fixture(scope="module")
def finding(tmp_path_factory: pytest.TempPathFactory) -> Finding:
    kept = tmp_path_factory.mktemp("kept") / "closures.partial"
    small = {"worlds": ("studio",), "seeds": (100,), "rounds": 2}
    return measure_closure_steps(Given(kept=kept), kind=QUIET, **small)


def value(finding: Finding, strategy: str, step: str, name: str) -> float:
    (row,) = [row for row in finding.rows if (row["strategy"], row["step"]) == (strategy, step)]
    return float(str(row[name]))


def test_every_step_leaves_less_and_is_more_right(finding: Finding) -> None:
    steps = ("ridges", "allowed by dead reckoning", "without rivals", "believed by the graph")
    pairs, precision = (
        [value(finding, SEQUENCE, step, name) for step in steps] for name in ("pairs", "precision")
    )
    assert pairs == sorted(pairs, reverse=True)
    assert precision == sorted(precision)
    assert precision[-1] > 0.9


def test_the_papers_steps_are_there(finding: Finding) -> None:
    on_lines = value(finding, PAPER, "on a line in its slice", "pairs")
    assert 0 < value(finding, PAPER, "mirrored, one per line", "pairs") < on_lines


def test_maps_with_curation_are_better_than_of_single_pairs(finding: Finding) -> None:
    curated = value(finding, SEQUENCE, "believed by the graph", "map, all believed (m)")
    single = value(finding, SINGLE, "believed by the graph", "map, all believed (m)")
    assert curated < single


def test_the_page_is_written(finding: Finding, tmp_path: Path) -> None:
    assert finding.page is not None
    save_page(tmp_path / "closures.html", finding.page)
    assert "Recall after each step" in (tmp_path / "closures.html").read_text(encoding="utf-8")

"""What taps are worth, in small: a map that was tapped lies on the plan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.values import Truth
from elfslam.scoring.page import save_page
from elfslam.world.kinds import QUIET
from studies.finding import Finding, Given
from studies.taps import ALIGNED, IN_FRAME, ON_PLAN, TAP_SIGMA_M, TAPS, measure_taps, tapped


@pytest.fixture(scope="module")
def finding() -> Finding:
    return measure_taps(Given(), worlds=("studio",), seeds=(100,), rounds=2, kind=QUIET)


def of(finding: Finding, measure: str) -> list[float]:
    return [float(str(row["mean"])) for row in finding.rows if row["measure"] == measure]


def test_a_tapped_map_lies_on_the_plan(finding: Finding) -> None:
    assert of(finding, ON_PLAN) == [1.0] * len(TAPS)
    assert of(finding, IN_FRAME)[-1] < 0.4
    assert max(of(finding, ALIGNED)) < 0.4


def test_its_page_is_written(finding: Finding, tmp_path: Path) -> None:
    assert finding.page is not None
    save_page(tmp_path / "page.html", finding.page)
    assert (tmp_path / "page.html").stat().st_size > 1000


def walk_m(length_m: float) -> Truth:
    """A walk along x at 1 m/s."""
    t_s = np.arange(0.0, length_m + 0.05, 0.1)
    return Truth(t_s, np.column_stack([t_s, np.zeros_like(t_s), np.zeros_like(t_s)]))


def test_taps_lie_around_the_walker() -> None:
    told = [tapped(walk_m(100.0), 4, seed) for seed in range(200)]
    off_m = np.array([each.xy_m - np.column_stack([each.t_s, np.zeros(4)]) for each in told])
    assert np.std(off_m) == pytest.approx(TAP_SIGMA_M, rel=0.1)
    assert np.abs(off_m.mean(axis=0)).max() < 0.1


@pytest.mark.parametrize("rounds", [2, 4])
@pytest.mark.parametrize("taps", TAPS[1:])
def test_taps_are_at_different_places_of_the_rounds(rounds: int, taps: int) -> None:
    place = tapped(walk_m(100.0), taps, 0).t_s * rounds / 100.0
    apart = np.abs((place[:, None] - place + 0.5) % 1.0 - 0.5)
    assert apart.max() > 0.2

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


def test_taps_lie_around_the_walker() -> None:
    t_s = np.linspace(0, 100, 1001)
    truth = Truth(t_s, np.column_stack([t_s, np.zeros_like(t_s), np.zeros_like(t_s)]))
    told = [tapped(truth, 4, seed) for seed in range(200)]
    np.testing.assert_allclose(told[0].t_s, [12.5, 37.5, 62.5, 87.5])
    off_m = np.array([each.xy_m for each in told]) - [[12.5, 0], [37.5, 0], [62.5, 0], [87.5, 0]]
    assert np.std(off_m) == pytest.approx(TAP_SIGMA_M, rel=0.1)
    assert np.abs(off_m.mean(axis=0)).max() < 0.1


def test_two_taps_are_at_two_places_of_a_round() -> None:
    t_s = np.linspace(0, 80, 801)
    truth = Truth(t_s, np.column_stack([t_s, np.zeros_like(t_s), np.zeros_like(t_s)]))
    np.testing.assert_allclose(tapped(truth, 2, 0).t_s, [5.0, 15.0])

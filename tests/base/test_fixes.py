"""Fixes of planted places: where weight gathers, and when nothing is said."""

import numpy as np
import pytest

from elfslam.base.fixes import moments, scored_fix
from elfslam.base.values import FixStatus
from elfslam.stages.locate import LocateParameters

XY_M = np.array([[0.0, 0.0], [0.5, 0.0], [9.0, 0.0]])
HEADING_RAD = np.array([0.0, 0.2, 3.0])
SPREAD_M2 = np.tile(0.01 * np.eye(2), (3, 1, 1))
RULE = LocateParameters()


def test_moments_are_those_of_weighted_places() -> None:
    xy, heading, covariance = moments(np.array([0.25, 0.75]), XY_M[:2], HEADING_RAD[:2])
    assert xy == pytest.approx([0.375, 0.0])
    assert heading == pytest.approx(0.15, abs=1e-3)
    assert covariance[0, 0] == pytest.approx(0.25 * 0.375**2 + 0.75 * 0.125**2)


@pytest.mark.parametrize(
    ("scores", "status", "x_m"),
    [
        ([0.9, 0.9, 0.1], FixStatus.OK, 0.25),
        ([0.9, 0.1, 0.9], FixStatus.AMBIGUOUS, 4.5),
        ([0.3, 0.2, 0.1], FixStatus.UNKNOWN_PLACE, np.nan),
    ],
)
def test_weight_near_the_best_decides(scores: list[float], status: FixStatus, x_m: float) -> None:
    alike = np.array(scores, dtype=np.float32)
    xy, _, covariance, score, found = scored_fix(alike, XY_M, HEADING_RAD, SPREAD_M2, RULE)
    assert found == status
    assert score == pytest.approx(max(scores))
    np.testing.assert_allclose(xy[0], x_m, atol=1e-4)
    if status is not FixStatus.UNKNOWN_PLACE:
        assert covariance[1, 1] == pytest.approx(0.01 + RULE.sigma_floor_m**2)

"""Closures against a truth planted by hand."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.values import Closures, Truth
from elfslam.scoring.closure_score import score_closures

T_S = np.arange(0.0, 50.0, 5.0)


def there_and_back() -> Truth:
    """Nodes 0 to 4 walk out 2 m each, nodes 5 to 9 come back 0.5 m beside."""
    x = np.concatenate([np.arange(5) * 2.0, np.arange(4, -1, -1) * 2.0])
    y = np.repeat([0.0, 0.5], 5)
    return Truth(T_S, np.column_stack([x, y, np.repeat([0, np.pi], 5)]))


def closures(*pairs: tuple[int, int]) -> Closures:
    i, j = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    size = i.size
    return Closures(i, j, np.ones(size), np.zeros((size, 3)), np.zeros((size, 3, 3)))


def test_right_and_wrong_closures_are_told_apart() -> None:
    score = score_closures(closures((0, 9), (1, 8), (2, 6)), T_S, there_and_back())
    assert score.right.tolist() == [True, True, False]
    assert np.allclose(score.distance_m, [0.5, 0.5, np.hypot(2 * 1.0, 0.5)])
    assert score.precision == pytest.approx(2 / 3)
    assert score.median_distance_m == pytest.approx(0.5)


def test_recall_counts_returning_nodes() -> None:
    """Node 5 comes 5 s after node 4, too soon to be a return; 6, 7, 8 and 9 return."""
    score = score_closures(closures((0, 9), (1, 8), (2, 6)), T_S, there_and_back())
    assert score.recall == pytest.approx(2 / 4)
    sooner = score_closures(closures((0, 9)), T_S, there_and_back(), revisit_s=5.0)
    assert sooner.recall == pytest.approx(1 / 5)


def test_the_radius_decides() -> None:
    strict = score_closures(closures((0, 9)), T_S, there_and_back(), radius_m=0.4)
    assert strict.precision == 0
    assert np.isnan(strict.recall)


def test_closures_outside_the_truth_are_not_judged() -> None:
    dense = there_and_back()
    part = Truth(dense.t_s[:9], dense.world_from_body[:9])
    score = score_closures(closures((0, 9), (1, 8)), T_S, part)
    assert score.count == 1
    assert score.precision == 1
    assert np.isnan(score.distance_m[0])


def test_no_closures_have_no_precision() -> None:
    score = score_closures(closures(), T_S, there_and_back())
    assert score.count == 0
    assert np.isnan(score.precision)
    assert np.isnan(score.median_distance_m)
    assert score.recall == 0

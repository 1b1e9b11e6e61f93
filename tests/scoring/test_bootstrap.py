"""The bootstrap interval: walks are the unit, the seed decides, and it covers."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.errors import InputError
from elfslam.scoring.bootstrap import interval


def mean(values: np.ndarray) -> float:
    return float(values.mean())


def test_same_seed_same_interval() -> None:
    walks = [np.arange(5.0), np.arange(9.0), np.ones(3)]
    first = interval(walks, mean, np.random.default_rng(3))
    assert first == interval(walks, mean, np.random.default_rng(3))
    assert first[0] < mean(np.concatenate(walks)) < first[1]


def test_one_walk_gives_its_own_value() -> None:
    assert interval([np.array([1.0, 3.0])], mean, np.random.default_rng(0)) == (2, 2)


def test_walks_are_drawn_not_footsteps() -> None:
    """A thousand equal footsteps in each of ten walks tell no more than ten numbers."""
    values = np.random.default_rng(1).normal(0, 1, 10)
    low, high = interval([np.full(1000, v) for v in values], mean, np.random.default_rng(0))
    few = interval([np.array([v]) for v in values], mean, np.random.default_rng(0))
    assert (low, high) == pytest.approx(few)
    assert high - low > 0.5


def test_about_95_of_100_intervals_cover() -> None:
    """Ninety is what a percentile interval of 25 walks should at least reach (seeds 0 to 99)."""
    covered = 0
    for seed in range(100):
        generator = np.random.default_rng(seed)
        low, high = interval(list(generator.normal(5, 2, (25, 1))), mean, generator)
        covered += low <= 5 <= high
    assert 88 <= covered <= 99


def test_nothing_is_refused() -> None:
    with pytest.raises(InputError, match="no values"):
        interval([np.empty(0)], mean, np.random.default_rng(0))

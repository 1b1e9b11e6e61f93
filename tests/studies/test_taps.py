"""What taps are worth, in small: a map that was tapped lies on the plan."""

import numpy as np
import pytest

from elfslam.base.values import Truth
from elfslam.world.kinds import QUIET
from studies.study import MEDIAN_ALIGNED, StudyContext
from studies.taps import IN_FRAME, STUDY, TAP_SIGMA_M, TAPS, measure_taps, tapped


def test_a_tapped_map_lies_on_the_plan() -> None:
    records = measure_taps(StudyContext(), kind=QUIET, **STUDY.fast)

    def of(metric: str) -> list[float]:
        return [each.value for each in records if each.metric == metric]

    assert np.isfinite(of(IN_FRAME)).all(), "it is on the plan"
    assert of(IN_FRAME)[-1] < 0.4
    assert max(of(MEDIAN_ALIGNED)) < 0.4


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

"""The study of acoustic odometry in small: sound mends the scale of a walk."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.values import Odometry, Truth
from elfslam.world.kinds import QUIET
from studies import acoustic_odometry
from studies.acoustic_odometry import CLAIMED, MAP, MEASURED, SCALE, SIGMA, TRUE, summarised
from studies.cached import SimulatedWalk
from studies.results import Record
from studies.study import StudyContext


def values_of(records: list[Record]) -> dict[tuple[str, str, str], float]:
    return {(each.world, each.method, each.metric): each.value for each in records}


def test_sound_mends_the_scale_of_a_walk(tmp_path: Path) -> None:
    kept = tmp_path / "kept.partial"
    walks = [SimulatedWalk("studio", 100, 2)]
    found = values_of(
        acoustic_odometry.measure_acoustic_odometry(
            StudyContext(kept=kept), walks=walks, kind=QUIET
        )
    )
    assert kept.exists()
    for world in ("studio", "all"):
        claimed, measured = (found[world, name, "scale error, rms (%)"]
                             for name in (CLAIMED, MEASURED))  # fmt: skip
        assert claimed > 3.0, "this walker's steps are not the usual ones"
        assert measured < 0.8 * claimed
        assert found[world, MEASURED, "refused walks"] == 0
    assert found["studio", MEASURED, MAP] < found["studio", CLAIMED, MAP]


def walk(true: float, scale: float, sigma: float, used: float) -> list[Record]:
    return [
        Record("sound alone", SCALE, scale), Record("sound alone", SIGMA, sigma),
        Record(CLAIMED, SCALE, 1.0), Record(MEASURED, SCALE, used), Record(TRUE, SCALE, true),
        Record(CLAIMED, MAP, 0.4), Record(MEASURED, MAP, 0.1 * used), Record(TRUE, MAP, 0.1),
    ]  # fmt: skip


def test_refused_walks_are_counted_but_not_in_the_normalised_error() -> None:
    walks = [walk(0.8, 0.82, 0.01, 0.8), walk(1.25, 1.0, float("inf"), 1.0)]
    found = values_of(list(summarised(walks, Record("", "", 0.0))))
    assert found["", MEASURED, "refused walks"] == 1
    assert found["", MEASURED, "NEES of the scale"] == pytest.approx(4.0)
    error = "scale error, rms (%)"
    assert found["", CLAIMED, error] == pytest.approx(100 * ((0.25**2 + 0.2**2) / 2) ** 0.5)
    assert found["", MEASURED, error] == pytest.approx(100 * (0.2**2 / 2) ** 0.5)
    assert found["", MEASURED, "walks improved (share)"] == 0.5
    assert found["", MEASURED, "map error over that of claimed steps"] == pytest.approx(0.225)


def test_walks_that_are_all_refused_have_no_normalised_error() -> None:
    walks = [walk(0.9, 1.0, float("inf"), 1.0)]
    found = values_of(list(summarised(walks, Record("", "", 0.0))))
    assert ("", MEASURED, "NEES of the scale") not in found


def test_the_true_scale_is_true_over_claimed_length() -> None:
    t_s = np.linspace(0.0, 10.0, 101)
    true = np.column_stack([1.2 * t_s, np.zeros(101), np.zeros(101)])
    nodes = Odometry(t_s[10:91:5], true[10:91:5] / [1.1, 1.0, 1.0] + 3.0, np.ones((16, 3)))
    assert acoustic_odometry.true_scale(nodes, Truth(t_s, true)) == pytest.approx(1.1)

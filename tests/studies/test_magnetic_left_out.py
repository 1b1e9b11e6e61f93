"""Magnetic closures chosen by leaving sets out: who chooses, and that the left out set does not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.errors import InputError
from studies.finding import Given
from studies.magnetic_left_out import (
    CHOICE_SEEDS,
    DriftedWalk,
    best_choice,
    hall_walk,
    measure_magnetic_left_out,
    measure_walk,
)
from studies.magnetic_walks import rmse_m
from studies.repeats import Numbers

BOLD, SHY = (0.45, 0.5, 0.35), (0.65, 3.0, 0.25)
NOBODY = (1.0, 1.0, 0.25)
"""Closures must be as alike as a stretch and itself: there are none."""


def test_a_choice_is_made_by_the_others_on_their_own_drifts_and_by_ratios() -> None:
    numbers: dict[DriftedWalk, Numbers] = {}
    for name, drifted, bold, shy in (("a", 10.0, 1.0, 2.0), ("b", 1.0, 0.4, 0.3), ("c", 1, 9, 1)):
        for seed in CHOICE_SEEDS:
            numbers[DriftedWalk(name, seed)] = {
                "drifted": drifted, str(BOLD): bold, str(SHY): shy
            }  # fmt: skip
    assert best_choice(["a", "b"], (BOLD, SHY), numbers) == BOLD
    assert best_choice(["b"], (BOLD, SHY), numbers) == SHY
    assert best_choice(["a", "b", "c"], (BOLD, SHY), numbers) == SHY


def test_a_set_is_mapped_with_what_the_other_chose(shared_data: Path) -> None:
    found = measure_magnetic_left_out(
        Given(shared_data), sets=("square", "eight"), choices=(BOLD, NOBODY)
    )
    assert [row["set"] for row in found.rows] == ["square", "eight"]
    for row in found.rows:
        assert row["threshold"] == BOLD[0]
        assert float(str(row["mapped (m)"])) < 0.8 * float(str(row["drifted (m)"]))


def test_without_closures_a_walk_stays_as_it_drifted(shared_data: Path) -> None:
    numbers = measure_walk(DriftedWalk("square", 101), shared_data, [NOBODY])
    assert numbers[str(NOBODY)] == pytest.approx(numbers["drifted"], rel=0.05)


def test_the_simulated_hall_is_long_and_drifts_by_metres() -> None:
    recording, truth = hall_walk(np.random.default_rng(0))
    assert recording.odometry is not None
    assert recording.magnetometer is not None
    steps_m = np.linalg.norm(np.diff(truth.world_from_body[:, :2], axis=0), axis=1)
    assert steps_m.sum() > 200
    drifted_m = rmse_m(recording.odometry.t_s, recording.odometry.world_from_body, truth)
    assert 3 < drifted_m < 8


def test_real_walks_are_asked_for_in_one_line() -> None:
    with pytest.raises(InputError, match="wanted real walks"):
        measure_magnetic_left_out(Given())

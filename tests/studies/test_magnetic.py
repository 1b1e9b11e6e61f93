"""Magnetic closures: aligned by their fields, and chosen by leaving sets out."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.values import Closures, Odometry
from elfslam.baselines.magnetic import FieldProfile
from studies import magnetic_left_out
from studies.magnetic_walks import RECKONED, RMSE, AlignmentParameters, align_closures
from studies.study import StudyContext

PARAMETERS = AlignmentParameters()


def field(x_m):
    """Three components along a corridor of 30 m, different everywhere."""
    generator = np.random.default_rng(4)
    frequency, phase = generator.uniform(0.05, 0.3, (8, 3)), generator.uniform(0, 7, (8, 3))
    return np.sin(2 * np.pi * frequency * x_m[:, None, None] + phase).sum(axis=1) / 2


def corridor(*, back):
    """30 m walked straight, then again from its start, or back: field by distance, and nodes."""
    along_m = np.arange(0.0, 60.0, 0.05)
    x_m = np.where(along_m < 30, along_m, 60 - along_m if back else along_m - 30)
    seen = field(x_m)
    if back:
        seen[along_m >= 30] *= [-1.0, -1.0, 1.0]
    walked_m = np.arange(0.0, 60.0, 0.5)
    poses = np.column_stack([walked_m, 0 * walked_m, 0 * walked_m])
    nodes = Odometry(walked_m, poses, np.full((119, 3), 0.05))
    return nodes, FieldProfile(along_m, seen, walked_m)


def claimed(i, j, heading_rad=0.0):
    return Closures(
        np.array([i]), np.array([j]), np.ones(1), np.array([[0.0, 0.0, heading_rad]]),
        0.01 * np.eye(3)[None],
    )  # fmt: skip


@pytest.mark.parametrize("shift", [-1, 0, 1])
def test_a_node_beside_the_right_one_is_put_where_it_belongs(shift):
    nodes, profile = corridor(back=False)
    found = align_closures(claimed(20, 80 + shift), nodes, profile, PARAMETERS)
    assert found.i_from_j[0] == pytest.approx([0.5 * shift, 0.0, 0.0], abs=0.03)


@pytest.mark.parametrize("shift", [-1, 0, 1])
def test_the_same_on_the_way_back(shift):
    nodes, profile = corridor(back=True)
    found = align_closures(claimed(20, 100 + shift, np.pi), nodes, profile, PARAMETERS)
    assert found.i_from_j[0, :2] == pytest.approx([-0.5 * shift, 0.0], abs=0.03)
    assert abs(found.i_from_j[0, 2]) == pytest.approx(np.pi, abs=1e-6)


def test_what_agrees_nowhere_is_dropped():
    nodes, profile = corridor(back=False)
    assert len(align_closures(claimed(20, 95), nodes, profile, PARAMETERS).i) == 0


def test_no_closures_stay_none():
    nodes, profile = corridor(back=False)
    none = Closures([], [], [], np.zeros((0, 3)), np.zeros((0, 3, 3)))
    assert len(align_closures(none, nodes, profile, PARAMETERS).i) == 0


BOLD, SHY = (0.45, 0.5, 0.35), (0.65, 3.0, 0.25)
NOBODY = (1.0, 1.0, 0.25)
"""Nothing scores as high as a stretch with itself: there are no closures."""


def test_a_choice_is_made_by_the_others_on_their_own_drifts_and_by_ratios() -> None:
    numbers: dict[magnetic_left_out.DriftedWalk, magnetic_left_out.Errors] = {}
    for name, drifted, bold, shy in (("a", 10.0, 1.0, 2.0), ("b", 1.0, 0.4, 0.3), ("c", 1, 9, 1)):
        for seed in magnetic_left_out.CHOICE_SEEDS:
            numbers[magnetic_left_out.DriftedWalk(name, seed)] = {
                RECKONED: drifted, str(BOLD): bold, str(SHY): shy
            }  # fmt: skip
    assert magnetic_left_out.best_choice(["a", "b"], (BOLD, SHY), numbers) == BOLD
    assert magnetic_left_out.best_choice(["b"], (BOLD, SHY), numbers) == SHY
    assert magnetic_left_out.best_choice(["a", "b", "c"], (BOLD, SHY), numbers) == SHY


def test_a_set_is_mapped_with_what_the_other_chose(shared_data: Path) -> None:
    records = magnetic_left_out.measure_magnetic_left_out(
        StudyContext(shared_data), sets=("square", "eight"), choices=(BOLD, NOBODY)
    )
    found = {(r.world, r.method, r.metric): r.value for r in records}
    for name, share in (("square", 0.4), ("eight", 0.8)):
        assert found[name, magnetic_left_out.LEFT_OUT, "threshold"] == BOLD[0]
        assert found[name, magnetic_left_out.LEFT_OUT, RMSE] < share * found[name, RECKONED, RMSE]

"""Closures aligned by their fields: a planted shift is found, what agrees nowhere is dropped."""

import numpy as np
import pytest

from elfslam.base.values import Closures, Odometry
from elfslam.baselines.magnetic import FieldProfile
from studies.magnetic_walks import AlignmentParameters, align_closures

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
    none = Closures(
        np.zeros(0, int), np.zeros(0, int), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3, 3))
    )
    assert len(align_closures(none, nodes, profile, PARAMETERS).i) == 0

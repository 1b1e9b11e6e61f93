"""Laws are met, and broken ones would show."""

from __future__ import annotations

import numpy as np
import pytest

from studies.fidelity import random_ends, random_polygon
from studies.physics import decay_s, eyring_s, measure_physics, moved
from studies.study import StudyContext


def test_every_law_is_met_in_few_rooms() -> None:
    records = measure_physics(StudyContext(), rooms=3, places=40)
    ours, accepted = records[0::2], records[1::2]
    assert len(ours) == 9 + 1 + 4
    for mine, most in zip(ours, accepted, strict=True):
        assert (mine.condition, most.method) == (most.condition, "accepted")
        assert abs(mine.value) <= most.value, mine


def test_eyring_of_a_cube() -> None:
    """4 m, half absorbed, air left out: 0.161 x 64 / (96 ln 2) = 0.155 s; air shortens it."""
    assert eyring_s((4.0, 4.0, 4.0), 0.5) < 0.155
    assert eyring_s((4.0, 4.0, 4.0), 0.5) == pytest.approx(
        0.1610 * 64 / (96 * np.log(2) + 8 * 64 * 0.047), rel=0.15
    )


def test_decay_follows_the_absorption_and_not_the_formula() -> None:
    """A decay held against the wrong absorption is off by far more than the goal."""
    assert decay_s((4.0, 4.3, 3.8), 0.4, 20) / eyring_s((4.0, 4.3, 3.8), 0.6) - 1 > 0.15


def test_a_moved_world_keeps_its_distances() -> None:
    generator = np.random.default_rng(3)
    room = random_polygon(generator)
    ends = random_ends(room, 0.5, generator)
    there, ends_there = moved(room, ends, 1.3, np.array([20.0, -5.0]))
    assert not np.allclose(there.outline_m, room.outline_m)
    for before, after in (
        (ends.speaker, ends_there.speaker),
        (ends.microphone, ends_there.microphone),
    ):
        assert after[0, 2] == before[0, 2]
        np.testing.assert_allclose(
            np.linalg.norm(there.outline_m - after[:, :2], axis=1),
            np.linalg.norm(room.outline_m - before[:, :2], axis=1),
        )
    for block, other in zip(room.blocks, there.blocks, strict=True):
        np.testing.assert_allclose(
            np.linalg.norm(other.corners_m - ends_there.speaker[:, :2], axis=1),
            np.linalg.norm(block.corners_m - ends.speaker[:, :2], axis=1),
        )

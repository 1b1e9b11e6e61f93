"""A phone held still: how it is held, and what it hears there."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F32, F64
from elfslam.world.world_file import load_world
from studies.still_phone import HAND_M, Listener, hear_at, held_still, listener_in, visit

SPOT_M = np.array([4.0, 3.0])


@pytest.fixture(scope="module")
def listener() -> Listener:
    return listener_in(load_world("studio").room)


def test_a_hand_moves_the_phone_a_little_about_where_it_is_held() -> None:
    poses = held_still(SPOT_M, 4000, np.random.default_rng(0), height_m=1.1, yaw_rad=np.pi / 2)
    np.testing.assert_allclose(poses.position_m.mean(axis=0), [4.0, 3.0, 1.1], atol=0.001)
    np.testing.assert_allclose(poses.position_m.std(axis=0), HAND_M, rtol=0.05)
    ahead = poses.world_from_phone[:, :2, 1]
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    assert np.degrees(headings.mean()) == pytest.approx(90.0, abs=0.2)
    assert 1.5 < np.degrees(headings.std()) < 2.5


def alike(first: F32, second: F32) -> F64:
    """Cosines of the envelopes in 32 pieces of each trace."""
    a, b = (np.abs(side).reshape(len(side), 49, 48).mean(axis=2) for side in (first, second))
    return np.asarray((a * b).sum(1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1))


def test_a_spot_sounds_more_like_itself_than_like_another(listener: Listener) -> None:
    generator = np.random.default_rng(1)
    here, again, there = (
        hear_at(listener, held_still(np.array(spot), 20, generator), generator)
        for spot in ([1.5, 1.5], [1.5, 1.5], [3.0, 2.5])
    )
    assert here.shape == (20, 2352)
    assert alike(here, again).mean() > alike(here, there).mean()


def test_a_visit_goes_to_each_spot_in_turn(listener: Listener) -> None:
    spots_m = np.array([[1.5, 1.5], [3.0, 2.5]])
    traces = visit(listener, spots_m, 5, np.random.default_rng(2))
    assert traces.shape == (10, 2352)
    first = visit(listener, spots_m[:1], 5, np.random.default_rng(2))
    np.testing.assert_array_equal(traces[:5], first)
    away = visit(listener, spots_m[:1], 5, np.random.default_rng(2), away_m=0.05)
    assert not np.array_equal(first, away)

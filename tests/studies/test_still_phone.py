"""A phone held still: how it is held, and what it hears there."""

import numpy as np
import pytest

from elfslam.world.world_file import load_world
from studies.still_phone import HAND_M, Listener, held_still, listener_in, visit

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


def test_a_visit_goes_to_each_spot_in_turn(listener: Listener) -> None:
    spots_m = np.array([[1.5, 1.5], [3.0, 2.5]])
    traces = visit(listener, spots_m, 5, np.random.default_rng(2))
    assert traces.shape == (10, 2352)
    first = visit(listener, spots_m[:1], 5, np.random.default_rng(2))
    np.testing.assert_array_equal(traces[:5], first)
    away = visit(listener, spots_m[:1], 5, np.random.default_rng(2), away_m=0.05)
    assert not np.array_equal(first, away)

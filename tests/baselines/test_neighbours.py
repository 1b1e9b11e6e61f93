"""Places of many walks: who may be near, what their field weighs, whom each is drawn to."""

import numpy as np
import pytest

from elfslam.base.values import Magnetometer, Odometry
from elfslam.baselines.neighbours import (
    NeighbourParameters,
    candidates,
    field_weights,
    field_windows,
    neighbour_closures,
)

PARAMETERS = NeighbourParameters(count=2)


def test_only_near_places_of_other_walks_are_asked():
    xy_m = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [100.0, 0.0]])
    near = candidates(xy_m, np.array([0, 0, 1, 1]), PARAMETERS)
    assert near.tolist() == [
        [False, False, True, False],
        [False, False, True, False],
        [True, True, False, False],
        [False, False, False, False],
    ]


def test_each_place_is_drawn_to_those_that_weigh_most_as_strongly_as_sigma_says():
    weights = np.zeros((4, 4))
    weights[0, 1:] = 3.0, 1.0, 0.5
    closures = neighbour_closures(weights, PARAMETERS)
    assert list(zip(closures.i, closures.j, strict=True)) == [(0, 1), (0, 2)]
    information = 1 / closures.covariance[:, 0, 0]
    assert information == pytest.approx(np.array([0.75, 0.25]) / PARAMETERS.sigma_m**2)
    assert (closures.covariance[:, 2, 2] > 1000.0).all()


def test_two_that_choose_each_other_make_one_closure_twice_as_strong():
    weights = np.array([[0.0, 1.0], [1.0, 0.0]])
    closures = neighbour_closures(weights, PARAMETERS)
    assert closures.i.tolist() == [0]
    assert closures.covariance[0, 0, 0] == pytest.approx(PARAMETERS.sigma_m**2 / 2)


def test_nothing_alike_gives_no_closure():
    assert len(neighbour_closures(np.zeros((3, 3)), PARAMETERS).i) == 0


def test_the_field_is_known_again_the_other_way_and_without_a_level():
    generator = np.random.default_rng(0)
    windows = generator.normal(size=(2, 33, 2))
    both = np.concatenate([windows, windows[:, ::-1]])
    heading_rad = np.array([0.0, 0.0, np.pi, np.pi])
    weights = field_weights(both, heading_rad, ~np.eye(4, dtype=bool), PARAMETERS)
    assert weights[0, 2] == pytest.approx(1.0)
    assert weights[0, 3] < 0.5
    assert (np.diag(weights) == 0).all()


def test_windows_hold_the_strength_about_each_node():
    t_s = np.arange(0.0, 20.0, 0.1)
    magnetometer = Magnetometer(t_s, np.column_stack([t_s, 0 * t_s, 0 * t_s]))
    nodes = Odometry(np.arange(20.0), np.outer(np.arange(20.0), [1, 0, 0]), np.full((19, 3), 0.1))
    windows = field_windows(magnetometer, None, nodes, PARAMETERS)
    assert windows.shape == (20, 33, 2)
    assert windows[10, 16, 1] == pytest.approx(10.0 / PARAMETERS.field_unit_ut, abs=0.05)

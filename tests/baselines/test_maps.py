"""Rivals: located in maps of their own kind alone, and neighbours among many walks."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Magnetometer, Odometry, Trajectory, WifiScans
from elfslam.baselines import maps, neighbours
from elfslam.baselines.magnetic import MagneticParameters
from elfslam.baselines.wifi import WifiFingerprintParameters
from elfslam.stages.locate import fixes_of

STEP_M, COUNT = 0.5, 60
POINTS_M = np.array([0.0, 8.0, 15.0, 22.0, 30.0])
T_S = np.arange(0.0, STEP_M * COUNT, 0.05)


def walked():
    """A straight walk of 30 m at 1 m/s, as reckoned and as mapped."""
    poses = np.column_stack([STEP_M * np.arange(COUNT), *np.zeros((2, COUNT))])
    t_s = STEP_M * np.arange(COUNT)
    odometry = Odometry(t_s, poses, np.full((COUNT - 1, 3), 0.05))
    covariance = np.tile(0.01 * np.eye(3), (COUNT, 1, 1))
    return odometry, Trajectory(t_s, poses, covariance, np.empty(0), "OK")


def scans(order=(0, 1, 2, 3, 4), noise_db=0.0):
    t_s = np.arange(0.0, 29.6, 0.5)
    away_m = np.maximum(np.abs(t_s[:, None] - POINTS_M), 1.0)
    rssi = -40.0 - 28.0 * np.log10(away_m)
    rssi = rssi + noise_db * np.random.default_rng(0).normal(size=rssi.shape)
    names = tuple("abcde"[k] for k in order)
    return WifiScans(t_s, names, rssi[:, order], np.zeros(rssi.shape))


def field(noise_ut=0.0):
    generator = np.random.default_rng(3)
    wave, phase = generator.uniform(0.1, 0.5, (6, 3)), generator.uniform(0, 7, (6, 3))
    bent = 4.0 * np.sin(2 * np.pi * wave * T_S[:, None, None] + phase).sum(axis=1)
    noise = noise_ut * np.random.default_rng(4).normal(size=bent.shape)
    return Magnetometer(T_S, np.array([15.0, 0.0, -42.0]) + bent + noise)


def off_m(scores, floor_map, known):
    nodes, _ = walked()
    middle_s = (nodes.t_s[1:] + nodes.t_s[:-1]) / 2
    fixes = fixes_of(middle_s, scores, floor_map, known)
    assert (fixes.status == 0).all()
    return np.abs(fixes.xy_m[:, 0] - floor_map.xy_m[:, 0])


@pytest.mark.parametrize("variant", ["tuned", "paper"])
def test_wifi_knows_the_place_whatever_the_order_of_the_access_points(variant):
    nodes, trajectory = walked()
    known = WifiFingerprintParameters(variant=variant, window_s=1.0)
    floor_map = maps.wifi_map(scans(), nodes, trajectory, known)
    scores = maps.wifi_spot_scores(scans((4, 2, 0, 1, 3), noise_db=1.0), nodes, floor_map, known)
    assert scores.shape == (COUNT - 1, COUNT - 1)
    assert np.median(off_m(scores, floor_map, maps.WIFI_LOCATE)) < 2.0
    npt.assert_allclose(floor_map.xy_m[:, 0], STEP_M * (np.arange(COUNT - 1) + 0.5))


@pytest.mark.parametrize("variant", ["tuned", "paper"])
def test_the_magnetic_field_knows_the_place(variant):
    nodes, trajectory = walked()
    known = MagneticParameters(variant=variant)
    floor_map = maps.magnetic_map(field(), None, nodes, trajectory, known)
    scores = maps.magnetic_spot_scores(field(noise_ut=0.3), None, nodes, floor_map, known)
    assert np.median(off_m(scores, floor_map, maps.MAGNETIC_LOCATE)) < 0.5


def test_a_map_of_another_kind_or_variant_is_refused():
    nodes, trajectory = walked()
    tuned = WifiFingerprintParameters()
    floor_map = maps.wifi_map(scans(), nodes, trajectory, tuned)
    with pytest.raises(InputError, match="wanted a payload wifi"):
        maps.wifi_spot_scores(scans(), nodes, floor_map, replace(tuned, variant="paper"))
    with pytest.raises(InputError, match="wanted a payload magnetic"):
        maps.magnetic_spot_scores(field(), None, nodes, floor_map, MagneticParameters())


PARAMETERS = neighbours.NeighbourParameters(count=2)


def test_only_near_places_of_other_walks_are_asked():
    xy_m = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [100.0, 0.0]])
    near = neighbours.candidates(xy_m, np.array([0, 0, 1, 1]), PARAMETERS)
    assert near.tolist() == [
        [False, False, True, False],
        [False, False, True, False],
        [True, True, False, False],
        [False, False, False, False],
    ]


def test_each_place_is_drawn_to_those_that_weigh_most_as_strongly_as_sigma_says():
    weights = np.zeros((4, 4))
    weights[0, 1:] = 3.0, 1.0, 0.5
    closures = neighbours.neighbour_closures(weights, PARAMETERS)
    assert list(zip(closures.i, closures.j, strict=True)) == [(0, 1), (0, 2)]
    information = 1 / closures.covariance[:, 0, 0]
    assert information == pytest.approx(np.array([0.75, 0.25]) / PARAMETERS.sigma_m**2)
    assert (closures.covariance[:, 2, 2] > 1000.0).all()


def test_two_that_choose_each_other_make_one_closure_twice_as_strong():
    weights = np.array([[0.0, 1.0], [1.0, 0.0]])
    closures = neighbours.neighbour_closures(weights, PARAMETERS)
    assert closures.i.tolist() == [0]
    assert closures.covariance[0, 0, 0] == pytest.approx(PARAMETERS.sigma_m**2 / 2)


def test_nothing_alike_gives_no_closure():
    assert len(neighbours.neighbour_closures(np.zeros((3, 3)), PARAMETERS).i) == 0


def test_what_weighs_next_to_nothing_gives_no_closure():
    weights = np.zeros((3, 3))
    weights[0, 1:] = 1.0, 1e-30
    closures = neighbours.neighbour_closures(weights, PARAMETERS)
    assert list(zip(closures.i, closures.j, strict=True)) == [(0, 1)]


def test_the_field_is_known_again_the_other_way_and_without_a_level():
    generator = np.random.default_rng(0)
    windows = generator.normal(size=(2, 33, 2))
    both = np.concatenate([windows, windows[:, ::-1]])
    heading_rad = np.array([0.0, 0.0, np.pi, np.pi])
    weights = neighbours.field_weights(both, heading_rad, ~np.eye(4, dtype=bool), PARAMETERS)
    assert weights[0, 2] == pytest.approx(1.0)
    assert weights[0, 3] < 0.5
    assert (np.diag(weights) == 0).all()


def test_windows_hold_the_strength_about_each_node():
    t_s = np.arange(0.0, 20.0, 0.1)
    magnetometer = Magnetometer(t_s, np.column_stack([t_s, 0 * t_s, 0 * t_s]))
    nodes = Odometry(np.arange(20.0), np.outer(np.arange(20.0), [1, 0, 0]), np.full((19, 3), 0.1))
    windows = neighbours.field_windows(magnetometer, None, nodes, PARAMETERS)
    assert windows.shape == (20, 33, 2)
    assert windows[10, 16, 1] == pytest.approx(10.0 / PARAMETERS.field_unit_ut, abs=0.05)

"""Rivals are located in maps of their own kind, and refused those of another."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import Magnetometer, Odometry, Trajectory, WifiScans
from elfslam.baselines.magnetic import MagneticParameters
from elfslam.baselines.maps import (
    MAGNETIC_LOCATE,
    WIFI_LOCATE,
    magnetic_map,
    magnetic_spot_scores,
    wifi_map,
    wifi_spot_scores,
)
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
    floor_map = wifi_map(scans(), nodes, trajectory, known)
    scores = wifi_spot_scores(scans((4, 2, 0, 1, 3), noise_db=1.0), nodes, floor_map, known)
    assert scores.shape == (COUNT - 1, COUNT - 1)
    assert np.median(off_m(scores, floor_map, WIFI_LOCATE)) < 2.0
    npt.assert_allclose(floor_map.xy_m[:, 0], STEP_M * (np.arange(COUNT - 1) + 0.5))


@pytest.mark.parametrize("variant", ["tuned", "paper"])
def test_the_magnetic_field_knows_the_place(variant):
    nodes, trajectory = walked()
    known = MagneticParameters(variant=variant)
    floor_map = magnetic_map(field(), None, nodes, trajectory, known)
    scores = magnetic_spot_scores(field(noise_ut=0.3), None, nodes, floor_map, known)
    assert np.median(off_m(scores, floor_map, MAGNETIC_LOCATE)) < 0.5


def test_a_map_of_another_kind_or_variant_is_refused():
    nodes, trajectory = walked()
    tuned = WifiFingerprintParameters()
    floor_map = wifi_map(scans(), nodes, trajectory, tuned)
    with pytest.raises(InputError, match="wanted a payload wifi"):
        wifi_spot_scores(scans(), nodes, floor_map, replace(tuned, variant="paper"))
    with pytest.raises(InputError, match="wanted a payload magnetic"):
        magnetic_spot_scores(field(), None, nodes, floor_map, MagneticParameters())

"""Normalised errors of displacements: two in the mean where the sigmas are right."""

import numpy as np
import pytest

from elfslam.base.geometry import chain
from elfslam.base.values import Odometry, Truth
from elfslam.scoring.consistency import Displacements, displacement_errors

STEPS = 150
STEP_M = 0.7
START = np.zeros(3)
STILL = np.zeros(3)


def planted(seed, step_sigma=STILL, scale_sigma=0.0, drift_radps=0.0, said=1.0):
    """A walk of a few turns and its odometry, wrong by what it says (or `said` times that)."""
    generator = np.random.default_rng(seed)
    moves = np.column_stack([np.full(STEPS, STEP_M), np.zeros(STEPS), np.zeros(STEPS)])
    moves[[40, 80, 110], 2] = [1.2, -0.8, 1.5]
    t_s = 0.5 * np.arange(STEPS + 1)
    wrong = moves + step_sigma * generator.standard_normal(moves.shape)
    wrong[:, :2] *= 1 + scale_sigma * generator.standard_normal()
    wrong[:, 2] += drift_radps * 0.5 * generator.standard_normal()
    sigma = np.tile(np.maximum(step_sigma, 1e-4) * said, (STEPS, 1))
    odometry = Odometry(t_s, chain(START, wrong), sigma, said * scale_sigma, said * drift_radps)
    return odometry, Truth(t_s, chain(START, moves))


def all_errors(distance_m, **options):
    found = [displacement_errors(*planted(seed, **options), distance_m) for seed in range(60)]
    return Displacements(
        np.vstack([one.error_m for one in found]),
        np.vstack([one.sigma_m for one in found]),
        np.concatenate([one.nees for one in found]),
    )


@pytest.mark.parametrize("distance_m", [5.0, 20.0, 60.0])
@pytest.mark.parametrize(
    "wrong",
    [
        {"step_sigma": np.array([0.2, 0.1, 0.01])},
        {"step_sigma": np.array([0.05, 0.05, 0.001]), "scale_sigma": 0.08},
        {"step_sigma": np.array([0.05, 0.05, 0.001]), "drift_radps": 0.002},
    ],
    ids=["steps", "scale", "drift"],
)
def test_right_sigmas_give_two_in_the_mean(distance_m, wrong):
    found = all_errors(distance_m, **wrong)
    assert len(found.nees) > 200
    assert found.nees.mean() == pytest.approx(2.0, abs=0.6)
    within = np.abs(found.error_m) < found.sigma_m
    assert within.mean() == pytest.approx(0.68, abs=0.08)


def test_sigmas_half_as_large_give_four_times_as_much():
    steps = {"step_sigma": np.array([0.2, 0.1, 0.01])}
    right, bold = all_errors(20.0, **steps), all_errors(20.0, **steps, said=0.5)
    assert bold.nees.mean() == pytest.approx(4 * right.nees.mean(), rel=0.01)
    np.testing.assert_allclose(bold.error_m, right.error_m)


def test_a_wrong_scale_errs_along_and_a_drift_across():
    odometry, truth = planted(0)
    longer = Odometry(odometry.t_s, odometry.world_from_body * [1.1, 1.1, 1.0], odometry.step_sigma)
    found = displacement_errors(longer, truth, 20.0)
    straight = np.abs(found.error_m[:, 1]) < 0.01
    assert straight.all()
    assert (found.error_m[:, 0] > 0.5).all()


def test_waypoints_count_with_their_own_error():
    odometry, dense = planted(1, step_sigma=np.array([0.2, 0.1, 0.01]))
    poses = dense.world_from_body[::8].copy()
    poses[:, 2] = np.nan
    waypoints = Truth(dense.t_s[::8], poses)
    sure, doubted = (displacement_errors(odometry, waypoints, 20.0, m) for m in (0.0, 0.5))
    assert len(sure.nees) > 5
    assert (doubted.sigma_m > sure.sigma_m).all()
    assert (doubted.sigma_m[:, 0] ** 2 - sure.sigma_m[:, 0] ** 2) == pytest.approx(0.5)


def test_a_short_walk_has_none():
    odometry, truth = planted(0)
    assert len(displacement_errors(odometry, truth, 500.0).nees) == 0

"""What is counted of fixes: errors of the answered, shares, and whether sigma is honest."""

import numpy as np
import pytest

from elfslam.base.geometry import compose
from elfslam.base.values import Fixes, FixStatus, Odometry, Run, Trajectory, Truth
from elfslam.slam.pipeline import no_similarity
from studies.located import MEDIAN_M, OVER_1_M, fix_numbers
from studies.mapping import NO_CLOSURES

T_S = np.arange(0.0, 10.0, 0.5)
TRUE = np.column_stack([T_S, 0.1 * T_S**2, np.zeros(len(T_S))])
MAP_FROM_WORLD = np.array([3.0, -2.0, 0.7])


def mapped() -> tuple[Run, Truth]:
    """A walk mapped without error, in axes of its own."""
    poses = compose(MAP_FROM_WORLD, TRUE)
    nodes = Odometry(T_S, poses, np.full((len(T_S) - 1, 3), 0.1))
    trajectory = Trajectory(T_S, poses, np.zeros((len(T_S), 3, 3)), np.empty(0), "OK")
    similarity = no_similarity(None, nodes)
    return Run("walk", nodes, similarity, NO_CLOSURES, trajectory, None, None, None), Truth(
        T_S, TRUE
    )


def fixes(off_m: float, sigma_m: float, refused: int) -> Fixes:
    """Fixes at the true places, off to one side; the first `refused` have no answer."""
    poses = compose(MAP_FROM_WORLD, TRUE + np.array([0.0, off_m, 0.0]))
    status = np.where(np.arange(len(T_S)) < refused, FixStatus.AMBIGUOUS, FixStatus.OK)
    covariance = np.tile(sigma_m**2 * np.eye(2), (len(T_S), 1, 1))
    return Fixes(T_S, poses[:, :2], poses[:, 2], covariance, np.ones(len(T_S)), status)


def test_errors_shares_and_sigmas() -> None:
    run, truth = mapped()
    found = fix_numbers(fixes(0.3, 0.15, refused=5), truth, run.trajectory, truth)
    assert found[MEDIAN_M] == pytest.approx(0.3)
    assert found["third quartile (m)"] == pytest.approx(0.3)
    assert found["NEES"] == pytest.approx(4.0)
    assert found["answered"] == pytest.approx(15 / 20)
    assert found[OVER_1_M] == 0.0
    assert fix_numbers(fixes(1.2, 0.15, refused=0), truth, run.trajectory, truth)[OVER_1_M] == 1.0


def test_no_answer_has_no_error() -> None:
    run, truth = mapped()
    found = fix_numbers(fixes(0.3, 0.15, refused=len(T_S)), truth, run.trajectory, truth)
    assert found["answered"] == 0.0
    assert np.isnan([found[MEDIAN_M], found[OVER_1_M], found["NEES"]]).all()

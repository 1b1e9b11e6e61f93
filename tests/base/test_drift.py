"""Drift between two footsteps: what many simulated walks scatter by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.drift import Drift
from elfslam.base.geometry import between, chain, compose, wrap_angle
from elfslam.base.values import Odometry

COUNT = 40
STEP_S = 0.5
SIGMA = np.array([0.03, 0.02, 0.01])


def curved_moves() -> F64:
    turn_rad = 0.08 * np.sin(np.arange(COUNT) / 5) + 0.03
    return np.column_stack([np.full(COUNT, 0.7), np.zeros(COUNT), turn_rad])


def walk(moves: F64, start: tuple[float, float, float] = (3.0, -2.0, 0.4)) -> Odometry:
    poses = chain(np.array(start), moves)
    return Odometry(STEP_S * np.arange(len(moves) + 1), poses, np.tile(SIGMA, (len(moves), 1)))


def scattered_ends(scale_sigma: float, turn_sigma_radps: float, i: int, j: int) -> F64:
    """Errors (k, 3) of the way from node i to node j, in the axes of the walk, of many walkers."""
    generator = np.random.default_rng(5)
    moves, clean = curved_moves()[i:j], walk(curved_moves()).world_from_body
    ends = []
    for _ in range(4000):
        noisy = moves + generator.normal(0, SIGMA, moves.shape)
        noisy[:, :2] *= 1 + scale_sigma * generator.normal()
        noisy[:, 2] += STEP_S * turn_sigma_radps * generator.normal()
        ends.append(chain(clean[i], noisy)[-1] - clean[j])
    errors = np.array(ends)
    errors[:, 2] = wrap_angle(errors[:, 2])
    return errors


@pytest.mark.parametrize(("i", "j"), [(0, 40), (7, 31), (12, 13)])
@pytest.mark.parametrize(("scale_sigma", "turn_sigma_radps"), [(0, 0), (0.05, 0), (0.02, 0.004)])
def test_the_covariance_is_that_of_many_walkers(
    i: int, j: int, scale_sigma: float, turn_sigma_radps: float
) -> None:
    wanted = np.cov(scattered_ends(scale_sigma, turn_sigma_radps, i, j).T)
    nodes = replace(
        walk(curved_moves()), scale_sigma=scale_sigma, heading_drift_sigma_radps=turn_sigma_radps
    )
    got = Drift(nodes).covariances(np.array([i]), np.array([j]))[0]
    npt.assert_allclose(got, wanted, atol=0.12 * np.abs(np.diag(wanted)).max())
    npt.assert_allclose(np.diag(got), np.diag(wanted), rtol=0.12)


def test_no_way_has_no_drift() -> None:
    same = np.array([0, 9])
    npt.assert_allclose(Drift(walk(curved_moves())).covariances(same, same), 0, atol=1e-15)


def test_moving_the_world_changes_no_disagreement() -> None:
    moves = curved_moves()
    i, j = np.array([0, 3, 10]), np.array([20, 15, 39])
    slack = np.array([0.3, 0.3, 0.2])
    here = Drift(walk(moves)).disagreement(i, j, 0.1, slack)
    far = Drift(walk(moves, (4000.0, -9000.0, 2.5))).disagreement(i, j, 0.1, slack)
    npt.assert_allclose(far, here, rtol=1e-6)


def test_the_disagreement_is_the_squared_mahalanobis_distance() -> None:
    nodes, slack = walk(curved_moves()), np.array([0.2, 0.2, 0.2])
    drift = Drift(nodes)
    i, j = np.array([2]), np.array([30])
    way = nodes.world_from_body[30] - nodes.world_from_body[2]
    way[2] = wrap_angle(way[2] - np.pi)
    covariance = drift.covariances(i, j)[0] + np.diag(slack**2)
    wanted = way @ np.linalg.inv(covariance) @ way
    npt.assert_allclose(drift.disagreement(i, j, np.pi, slack), [wanted])


def test_who_comes_back_agrees_and_who_went_on_does_not() -> None:
    """A square walked once and a bit more, and a straight walk of the same length."""
    side = np.zeros((10, 3))
    side[:, 0] = 0.7
    side[-1, 2] = np.pi / 2
    square, straight = walk(np.tile(side, (4, 1))), walk(np.tile(side[:1], (40, 1)))
    ends, slack = (np.array([0]), np.array([40])), np.array([0.3, 0.3, 0.3])
    assert Drift(square).disagreement(*ends, 0.0, slack)[0] < 1
    assert Drift(straight).disagreement(*ends, 0.0, slack)[0] > 100
    back = compose(between(square.world_from_body[0], square.world_from_body[0]), np.zeros(3))
    npt.assert_allclose(back, 0, atol=1e-12)

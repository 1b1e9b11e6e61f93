"""Whether a trajectory is as uncertain as it says: how often its sigmas hold the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import Trajectory, Truth
from elfslam.scoring.errors import Alignment, SimilarityTransform, match, place, placement


@dataclass(frozen=True)
class Coverage:
    """Shares of footsteps whose true x (or y) lies within one and two sigma, both axes pooled.

    0.68 and 0.95 where the sigmas are right. `nees` is the mean normalised error squared in the
    plane, 2 where they are.
    """

    one_sigma: float
    two_sigma: float
    nees: float


def trajectory_coverage(
    trajectory: Trajectory, truth: Truth, where: SimilarityTransform | None = None
) -> Coverage:
    """Against a dense truth, the map lying `where` it does in the world.

    By default anchored at its first pose, which the covariance takes for certain.
    """
    matched = match(trajectory.t_s, trajectory.world_from_body, truth)
    where = where or placement(matched, Alignment.ANCHORED)
    error_m = place(matched.estimate, where)[:, :2] - matched.truth[:, :2]
    covariance = _turned(_at(trajectory, matched.t_s), float(where.world_from_map[2]))
    sigma_m = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    away = np.abs(error_m[1:]) / sigma_m[1:]
    solved = np.linalg.solve(covariance[1:], error_m[1:, :, None])[:, :, 0]
    nees = float(np.mean(np.sum(error_m[1:] * solved, axis=1)))
    return Coverage(float(np.mean(away <= 1)), float(np.mean(away <= 2)), nees)


def _at(trajectory: Trajectory, t_s: F64) -> F64:
    """Covariances (m, 2, 2) of the nearest footstep before each time."""
    row = np.clip(np.searchsorted(trajectory.t_s, t_s, side="right") - 1, 0, None)
    return np.asarray(trajectory.covariance[row][:, :2, :2])


def _turned(covariance: F64, angle_rad: float) -> F64:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    return np.asarray(turn @ covariance @ turn.T)

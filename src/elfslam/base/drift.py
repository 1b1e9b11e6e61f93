"""Covariance propagation of dead reckoning: the drift between two of its nodes."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import Odometry


class Drift:
    """The covariance of the way from one node to a later one, for any pair, from sums kept once.

    Steps err independently, each with its own sigmas; a heading error swings all that follows. The
    odometry's `scale_sigma` and `heading_drift_sigma_radps` bear on all steps alike.
    """

    def __init__(self, odometry: Odometry) -> None:
        self._poses, self._t_s = odometry.world_from_body, odometry.t_s
        self._scale_sigma = odometry.scale_sigma
        self._heading_drift_sigma_radps = odometry.heading_drift_sigma_radps
        turn = odometry.step_sigma[:, 2] ** 2
        # Relative to the middle of the walk: far from the origin the sums below would cancel.
        self._xy_m = self._poses[:, :2] - self._poses[:, :2].mean(axis=0)
        after = self._xy_m[1:]
        self._steps = _summed(_step_covariances(odometry))
        self._turns = _summed(turn)
        self._swings = _summed(turn[:, None] * after)
        self._drifts = _summed(np.diff(self._t_s)[:, None] * after)
        self._squares = _summed(turn[:, None, None] * after[:, :, None] * after[:, None, :])

    def covariances(self, i: I64, j: I64) -> F64:
        """Covariance (k, 3, 3) of x, y and heading of nodes j as seen from nodes i <= j.

        In the axes of the odometry, m and rad; to first order.
        """
        end = self._xy_m[j]
        turns, swings = self._turns[j] - self._turns[i], self._swings[j] - self._swings[i]
        lever = turns[:, None] * end - swings
        cross = end[:, :, None] * swings[:, None, :]
        spread = turns[:, None, None] * end[:, :, None] * end[:, None, :]
        spread += self._squares[j] - self._squares[i] - cross - np.swapaxes(cross, 1, 2)
        way = end - self._xy_m[i]
        covariance = np.zeros((len(end), 3, 3))
        covariance[:, :2, :2] = self._steps[j] - self._steps[i] + _turned(spread)
        covariance[:, :2, :2] += self._scale_sigma**2 * way[:, :, None] * way[:, None, :]
        covariance[:, :2, 2] = covariance[:, 2, :2] = np.column_stack([-lever[:, 1], lever[:, 0]])
        covariance[:, 2, 2] = turns
        return np.asarray(covariance + self._steady_turn(i, j))

    def _steady_turn(self, i: I64, j: I64) -> F64:
        """What a heading that drifts steadily adds (k, 3, 3)."""
        lasting_s = self._t_s[j] - self._t_s[i]
        lever = lasting_s[:, None] * self._xy_m[j] - (self._drifts[j] - self._drifts[i])
        swing = np.column_stack([-lever[:, 1], lever[:, 0], lasting_s])
        return np.asarray(
            self._heading_drift_sigma_radps**2 * swing[:, :, None] * swing[:, None, :]
        )

    def disagreement(self, i: I64, j: I64, turn_rad: F64 | float, slack: F64) -> F64:
        """Squared Mahalanobis distance (k) of "node j is where node i is, turned by `turn_rad`".

        `slack` (3, m m rad) is how exactly "where" is meant, one sigma per axis. With three
        degrees of freedom.
        """
        way = self._poses[j] - self._poses[i]
        way[:, 2] = wrap_angle(way[:, 2] - turn_rad)
        covariance = self.covariances(i, j) + np.diag(np.square(slack))
        return np.asarray(np.einsum("ki,ki->k", way, _solved(covariance, way)))


def _solved(covariance: F64, way: F64) -> F64:
    return np.asarray(np.linalg.solve(covariance, way[:, :, None])[:, :, 0])


def _summed(terms: F64) -> F64:
    """Sums (n+1, ...) of the first k terms."""
    return np.concatenate([np.zeros((1, *terms.shape[1:])), np.cumsum(terms, axis=0)])


def _step_covariances(odometry: Odometry) -> F64:
    """Covariance (n-1, 2, 2) of each step's end, forward and lateral turned into the axes."""
    heading_rad = odometry.world_from_body[:-1, 2]
    forward = np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    left = np.column_stack([-forward[:, 1], forward[:, 0]])
    variance = odometry.step_sigma**2
    along = variance[:, 0, None, None] * forward[:, :, None] * forward[:, None, :]
    return np.asarray(along + variance[:, 1, None, None] * left[:, :, None] * left[:, None, :])


def _turned(spread: F64) -> F64:
    """The same second moments (k, 2, 2) of vectors turned by a right angle."""
    return np.asarray(spread[:, ::-1, ::-1].swapaxes(1, 2) * np.array([[1.0, -1.0], [-1.0, 1.0]]))

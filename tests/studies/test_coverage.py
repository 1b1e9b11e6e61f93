"""Sigmas that are right hold the truth as often as they should."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.values import Trajectory, Truth
from studies.mapping import trajectory_coverage

COUNT = 4000


def scattered(said_sigma_m: float) -> tuple[Trajectory, Truth]:
    """A walk whose positions err by 0.2 m and say that they err by `said_sigma_m`."""
    generator = np.random.default_rng(0)
    t_s = 0.5 * np.arange(COUNT)
    true = np.column_stack([0.7 * np.arange(COUNT), np.zeros((COUNT, 2))])
    poses = true + np.column_stack([generator.normal(0, 0.2, (COUNT, 2)), np.zeros(COUNT)])
    poses[0] = true[0]
    covariance = np.tile(np.diag([said_sigma_m**2, said_sigma_m**2, 1e-4]), (COUNT, 1, 1))
    return Trajectory(t_s, poses, covariance, [], "OK"), Truth(t_s, true)


def test_right_sigmas_hold_68_and_95_of_a_hundred() -> None:
    found = trajectory_coverage(*scattered(0.2))
    assert found.one_sigma == pytest.approx(0.683, abs=0.02)
    assert found.two_sigma == pytest.approx(0.954, abs=0.01)
    assert found.nees == pytest.approx(2.0, abs=0.1)


def test_boasting_and_modest_sigmas_are_noticed() -> None:
    boasting, modest = trajectory_coverage(*scattered(0.1)), trajectory_coverage(*scattered(0.4))
    assert boasting.one_sigma < 0.45
    assert boasting.nees == pytest.approx(8.0, abs=0.4)
    assert modest.one_sigma > 0.9
    assert modest.nees == pytest.approx(0.5, abs=0.05)

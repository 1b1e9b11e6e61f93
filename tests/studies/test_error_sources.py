"""Planted errors show where they come from."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F64
from studies.error_sources import end_errors

TRUE_M = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [25.0, 5.0]])


def turned(angle_rad: float) -> F64:
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    return TRUE_M @ np.array([[cos, sin], [-sin, cos]])


def test_a_perfect_walk_has_none() -> None:
    assert max(end_errors(TRUE_M, TRUE_M).values()) < 1e-9


def test_a_wrong_scale_is_cured_by_lengths_alone() -> None:
    found = end_errors(1.2 * TRUE_M, TRUE_M)
    assert found["nothing"] == pytest.approx(0.2 * np.hypot(25, 5) / 30)
    assert found["the whole length"] == pytest.approx(0, abs=1e-9)
    assert found["the length of every leg"] == pytest.approx(0, abs=1e-9)
    assert found["the heading of the whole walk"] == pytest.approx(found["nothing"])
    assert found["the direction of every leg"] == pytest.approx(found["nothing"])


def test_a_wrong_heading_is_cured_by_directions_alone() -> None:
    found = end_errors(turned(0.3), TRUE_M)
    assert found["nothing"] == pytest.approx(2 * np.sin(0.15) * np.hypot(25, 5) / 30)
    assert found["the whole length"] == pytest.approx(found["nothing"])
    assert found["the length of every leg"] == pytest.approx(found["nothing"])
    assert found["the heading of the whole walk"] == pytest.approx(0, abs=1e-9)
    assert found["the direction of every leg"] == pytest.approx(0, abs=1e-9)


def test_one_bent_leg_is_cured_by_directions_of_legs() -> None:
    bent = TRUE_M.copy()
    bent[3] = [10 + 15 * np.cos(0.5), 5 + 15 * np.sin(0.5)]
    found = end_errors(bent, TRUE_M)
    assert found["the heading of the whole walk"] > 0.02
    assert found["the direction of every leg"] == pytest.approx(0, abs=1e-9)

"""Walks on floor plans: placed where they were, refused where that cannot be told."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import NoAnswerError
from elfslam.base.geometry import inverse
from elfslam.base.grid import FloorGrid, drawn_grid, walked_grid
from elfslam.stages import floor_plan_alignment as alignment

KNOWN = alignment.AnchoringParameters(cell_m=0.15)
CORRIDOR = np.array([[1, 1], [11, 1], [11, 5], [7, 5], [7, 8.0]])
"""The middle of a corridor that no turn maps onto itself."""
PLAN = walked_grid([CORRIDOR], 0.7, 0.05)
WORLD_FROM_MAP = np.array([3.0, -2.0, 2.1])


def seen(walk: F64, scale: float = 1.0) -> F64:
    """A walk on the plan as a map has it: in a frame of its own, and of another scale."""
    return alignment.placed(walk, inverse(WORLD_FROM_MAP), 1.0) / scale


def room(x_m: float, y_m: float) -> FloorGrid:
    return drawn_grid([(np.array([[0, 0], [x_m, 0], [x_m, y_m], [0, y_m]]),)], [], 0.05)


def errors_m(walk: F64, placement: alignment.Placement, scale: float = 1.0) -> F64:
    found = alignment.placed(seen(walk, scale), placement.plan_from_map, placement.scale)
    return np.asarray(np.linalg.norm(found - walk, axis=1))


def test_a_walk_along_a_corridor_is_placed_where_it_was() -> None:
    found = alignment.anchor([seen(CORRIDOR)], PLAN, KNOWN)
    assert found.status == alignment.OK
    assert found.shares[0] > 0.99
    assert errors_m(CORRIDOR, found).max() < 0.3
    assert found.off_share == 0.0
    assert np.sqrt(np.diag(found.covariance))[:2].max() < 0.3


def test_the_scale_is_found_within_what_is_allowed() -> None:
    loose = replace(KNOWN, scale_sigma=0.05)
    narrow = walked_grid([CORRIDOR], 0.5, 0.05)
    found = alignment.anchor([seen(CORRIDOR, 1.07)], narrow, loose)
    assert found.status == alignment.OK
    assert found.scale == pytest.approx(1.07, abs=0.03)
    exact = alignment.anchor([seen(CORRIDOR)], PLAN, replace(KNOWN, scale_sigma=0.0))
    assert exact.scale == pytest.approx(1.0)


@pytest.mark.parametrize("by_m", [[40.0, -7.0], [5e5, 5e6]])
def test_moving_the_plan_or_the_map_moves_the_answer(by_m: list[float]) -> None:
    moved = FloorGrid(PLAN.free, PLAN.corner_m + by_m, PLAN.cell_m)
    walk = seen(CORRIDOR)
    here, there = (alignment.anchor([walk], plan, KNOWN) for plan in (PLAN, moved))
    npt.assert_allclose(there.plan_from_map - here.plan_from_map, [*by_m, 0], atol=1e-6)
    npt.assert_allclose(there.covariance, here.covariance, atol=1e-6)
    far = alignment.anchor([walk + by_m], PLAN, KNOWN)
    lies = alignment.placed(walk, here.plan_from_map, here.scale)
    laid = alignment.placed(walk + by_m, far.plan_from_map, far.scale)
    npt.assert_allclose(laid, lies, atol=1e-6)
    npt.assert_allclose(far.covariance, here.covariance, atol=1e-6)


def test_a_plan_that_looks_the_same_turned_gives_both_and_decides_nothing() -> None:
    plan = room(9.0, 5.0)
    lap = np.array([[0.8, 0.8], [8.2, 0.8], [8.2, 4.2], [0.8, 4.2], [0.8, 0.8]])
    found = alignment.anchor([seen(lap)], plan, KNOWN)
    assert found.status == alignment.AMBIGUOUS
    assert len(found.shares) == 2
    npt.assert_allclose(found.shares, 0.5, atol=0.05)
    turn = np.exp(1j * (found.others[0, 2] - found.plan_from_map[2]))
    assert turn.real < -0.95


def test_a_known_start_decides_between_them() -> None:
    lap = np.array([[0.8, 0.8], [8.2, 0.8], [8.2, 4.2], [0.8, 4.2], [0.8, 0.8]])
    tag = alignment.Tag(seen(lap)[0], lap[0] + np.array([0.5, -0.3]))
    found = alignment.anchor([seen(lap)], room(9.0, 5.0), KNOWN, tag)
    assert found.status == alignment.OK
    assert errors_m(lap, found).max() < 0.6


def test_a_short_walk_in_a_wide_hall_may_have_been_anywhere() -> None:
    found = alignment.anchor([np.array([[0.0, 0.0], [3.0, 0.0]])], room(12.0, 10.0), KNOWN)
    assert found.status == alignment.AMBIGUOUS
    assert found.shares[0] < 0.5


def test_a_walk_that_fits_nowhere_is_not_placed() -> None:
    found = alignment.anchor([seen(CORRIDOR)], room(6.0, 4.0), KNOWN)
    assert found.status == alignment.NOWHERE
    assert found.off_share > 0.2


def test_a_plan_too_narrow_to_stand_in_holds_nobody() -> None:
    found = alignment.anchor([seen(CORRIDOR)], room(12.0, 0.5), KNOWN)
    assert (found.status, found.off_share) == (alignment.NOWHERE, 1.0)


def test_walking_a_lap_again_is_no_new_evidence() -> None:
    again = np.concatenate([CORRIDOR, CORRIDOR[::-1], CORRIDOR])
    once, thrice = (alignment.anchor([seen(walk)], PLAN, KNOWN) for walk in (CORRIDOR, again))
    npt.assert_allclose(thrice.covariance, once.covariance, rtol=0.3, atol=0.002)


def test_placing_stretches_turns_and_moves() -> None:
    corners = np.array([[1.0, 0.0], [0.0, 2.0]])
    there = alignment.placed(corners, np.array([10.0, 20.0, np.pi / 2]), 2.0)
    npt.assert_allclose(there, [[10, 22], [6, 20]], atol=1e-12)


@pytest.mark.parametrize("far_m", [50.0, 1e6, 1e15])
def test_a_walk_far_larger_than_the_plan_is_not_even_tried(far_m: float) -> None:
    with pytest.raises(NoAnswerError, match="across and the plan"):
        alignment.anchor([CORRIDOR, CORRIDOR + far_m], PLAN, KNOWN)

"""Points of interest go with the walk that named them, and those of several walks become one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.geometry import compose
from elfslam.base.values import PointKind, PointOfInterest, Trajectory
from elfslam.stages.carried_points import carried, gathered

DOOR = PointOfInterest("Door", PointKind.DOOR, 2.0, 1.0)
COUNT = 5
STRAIGHT = Trajectory(
    np.arange(COUNT) / 2,
    np.column_stack([np.arange(COUNT), np.zeros(COUNT), np.zeros(COUNT)]).astype(float),
    np.tile(np.eye(3), (COUNT, 1, 1)),
    np.zeros(0),
    "OK",
)


def test_a_walk_that_is_turned_and_moved_takes_its_points_along() -> None:
    move = np.array([10.0, -3.0, np.pi / 2])
    moved = replace(STRAIGHT, world_from_body=compose(move, STRAIGHT.world_from_body))
    (found,) = carried([DOOR], STRAIGHT, moved)
    assert (found.name, found.kind) == (DOOR.name, DOOR.kind)
    assert (found.x_m, found.y_m) == pytest.approx((9.0, -1.0))


def test_where_a_walk_is_bent_a_point_stays_beside_its_footstep() -> None:
    poses = STRAIGHT.world_from_body.copy()
    poses[3:, 1] += 5.0
    (found,) = carried([DOOR], STRAIGHT, replace(STRAIGHT, world_from_body=poses))
    assert (found.x_m, found.y_m) == pytest.approx((2.0, 1.0)), "only later footsteps moved"


def test_one_place_named_by_several_walks_lies_in_their_middle() -> None:
    other = replace(DOOR, name="door", x_m=4.0)
    assert gathered([DOOR, other]) == [replace(DOOR, x_m=3.0)]


def test_what_is_far_away_or_of_another_kind_stays_apart() -> None:
    apart = [DOOR, replace(DOOR, x_m=20.0), replace(DOOR, kind=PointKind.ROOM)]
    assert gathered(apart) == apart
    assert gathered([]) == []

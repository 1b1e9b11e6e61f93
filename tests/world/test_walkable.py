"""Where people can go: a quarter of a metre off everything, measured exactly."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base.arrays import F64
from elfslam.world.materials import material
from elfslam.world.room import Block, Room, box, shoebox
from elfslam.world.walkable import (
    fault_of_route,
    in_the_way,
    meets_block,
    point_gap_m,
    segment_gap_m,
    standing_room,
)

WALLS = (material("plaster"),) * 6
STOOL = box("stool", np.array([2.0, 1.0, 0.0]), np.array([1.0, 0.5, 0.5]))
LAMP = box("lamp", np.array([4.0, 1.0, 1.85]), np.array([1.0, 0.5, 0.5]))
ROOM = shoebox(np.array([6.0, 4.0, 2.5]), WALLS, (STOOL, LAMP))
ANGLE = Room(
    np.array([[0.0, 0], [4, 0], [4, 2], [2, 2], [2, 4], [0, 4]]), 2.5, WALLS, WALLS[0], WALLS[0]
)


def at(*xy: float) -> F64:
    return np.array(xy, dtype=np.float64)


def test_distances_in_plan() -> None:
    points = np.array([[0.0, 1.0], [1.5, -2.0], [5.0, 0.0]])
    assert point_gap_m(points, at(0, 0), at(2, 0)).tolist() == [1.0, 2.0, 3.0]
    assert segment_gap_m(at(0, 0), at(2, 0), at(0, 1), at(2, 3)) == 1.0
    assert segment_gap_m(at(0, 0), at(2, 0), at(1, -1), at(1, 1)) == 0.0


@pytest.mark.parametrize(
    ("y", "free"), [(0.74, True), (0.76, False), (1.2, False), (1.74, False), (1.76, True)]
)
def test_half_a_person_stays_off_the_stool(y: float, free: bool) -> None:
    way = np.array([[0.5, y], [5.5, y]])
    assert (fault_of_route(ROOM, way, closed=False) is None) is free
    assert standing_room(ROOM, at(2.5, y)[None])[0] == free
    assert (in_the_way(ROOM, *way) == '"stool"') is not free


@pytest.mark.parametrize(("x", "free"), [(0.24, False), (0.26, True), (5.74, True), (5.76, False)])
def test_half_a_person_stays_off_the_walls(x: float, free: bool) -> None:
    assert standing_room(ROOM, at(x, 3.0)[None])[0] == free
    assert (in_the_way(ROOM, at(x, 2.5), at(x, 3.0)) is None) is free


def test_what_hangs_above_the_head_is_no_obstacle() -> None:
    assert in_the_way(ROOM, at(4.5, 0.5), at(4.5, 3.5)) is None
    assert standing_room(ROOM, at(4.5, 1.2)[None])[0]


def test_a_corner_of_the_room_is_not_cut() -> None:
    assert in_the_way(ANGLE, at(3.5, 1.0), at(1.0, 3.5)) is not None
    assert in_the_way(ANGLE, at(3.5, 1.0), at(1.0, 1.0)) is None
    assert "outside" in str(in_the_way(ANGLE, at(1.0, 1.0), at(3.0, 3.0)))
    assert "(side 3)" in str(in_the_way(ANGLE, at(2.5, 1.8), at(3.5, 1.8)))


def test_a_closed_route_walks_home() -> None:
    around = np.array([[0.5, 0.5], [3.5, 0.5], [3.5, 2.0], [0.5, 2.0]])
    assert fault_of_route(ROOM, around, closed=True) is None
    through = np.array([[0.5, 1.2], [0.5, 3.0], [3.5, 3.0], [3.5, 1.2]])
    assert fault_of_route(ROOM, through, closed=False) is None
    assert "leg 4 (the one that closes it)" in str(fault_of_route(ROOM, through, closed=True))


def test_routes_that_lead_nowhere() -> None:
    place = np.array([[0.5, 0.5], [0.5, 0.5]])
    assert "fewer than 2 distinct corners" in str(fault_of_route(ROOM, place, closed=True))
    short = np.array([[0.5, 0.5], [1.4, 0.5]])
    assert "is 1.80 m long" in str(fault_of_route(ROOM, short, closed=True))
    assert "is 0.90 m long" in str(fault_of_route(ROOM, short, closed=False))


@given(turn_rad=st.floats(-3.0, 3.0), ends=st.tuples(*[st.floats(-3.0, 3.0)] * 4))
def test_a_turned_block_is_met_where_points_along_the_way_are_in_it(
    turn_rad: float, ends: tuple[float, ...]
) -> None:
    """Against dense points in a frame turned the other way; near misses are left out."""
    block = Block("b", WALLS[0], at(0.2, -0.1), at(1.6, 0.6, 1.0), turn_rad)
    a, b = at(*ends[:2]), at(*ends[2:])
    points = a + np.linspace(0, 1, 2001)[:, None] * (b - a) - block.centre_m
    cos, sin = np.cos(-turn_rad), np.sin(-turn_rad)
    local = points @ np.array([[cos, sin], [-sin, cos]])
    depth_m = float((np.abs(local) - [1.05, 0.55]).max(axis=1).min())
    if abs(depth_m) > 0.005:
        assert bool(meets_block(block, a[None], b[None])[0]) == (depth_m < 0)

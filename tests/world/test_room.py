"""Rooms: polygons, blocks in them, and places that are free."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.world import room as rooms
from elfslam.world.materials import material

ELL_M = np.array([[0, 0], [6, 0], [6, 3], [3, 3], [3, 5], [0, 5]], dtype=float)
WOOD = material("wood panel")


def ell(*blocks: rooms.Block) -> rooms.Room:
    return rooms.Room(ELL_M, 2.5, (WOOD,) * 6, WOOD, WOOD, blocks)


def test_an_outline_becomes_counter_clockwise() -> None:
    assert (rooms.check_outline(ELL_M) == ELL_M).all()
    assert (rooms.check_outline(ELL_M[::-1]) == ELL_M).all()


@pytest.mark.parametrize(
    ("outline_m", "complaint"),
    [
        ([[0, 0], [1, 0]], "wanted at least 3 corners, got 2; add some"),
        ([[0, 0], [4, 0], [4, 0], [0, 4]], "corners 2 and 3 are one place"),
        ([[0, 0], [4, 0], [4, 4], [0, 0.001]], "corners 4 and 1 are one place"),
        ([[0, 0], [4, 4], [4, 0], [0, 4]], "side 1 from .* crosses side 3 from .*; reorder"),
    ],
)
def test_bad_outlines_are_refused(outline_m: list[list[float]], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        rooms.check_outline(np.array(outline_m, dtype=float))


@pytest.mark.parametrize(
    ("ends", "expected"),
    [
        (([0, 0], [2, 2], [0, 2], [2, 0]), True),
        (([0, 0], [2, 0], [1, 0], [1, 3]), True),
        (([0, 0], [2, 0], [3, 0], [4, 0]), False),
        (([0, 0], [2, 0], [1, 0], [4, 0]), True),
        (([0, 0], [2, 0], [0, 1], [2, 1]), False),
        (([0, 0], [2, 0], [3, -1], [3, 1]), False),
    ],
)
def test_segments_that_cross(ends: tuple[list[float], ...], expected: bool) -> None:
    a, b, c, d = (np.array(end, dtype=float) for end in ends)
    assert rooms.segments_cross(a, b, c, d) == rooms.segments_cross(c, d, b, a) == expected


def test_a_block_is_turned_about_its_middle() -> None:
    block = rooms.box("table", [1.0, 1.0, 0.0], [2.0, 1.0, 0.7], turn_rad=np.pi / 2)
    expected = [[2.5, 0.5], [2.5, 2.5], [1.5, 2.5], [1.5, 0.5]]
    np.testing.assert_allclose(block.corners_m, expected, atol=1e-12)
    assert block.top_m == 0.7
    np.testing.assert_allclose(block.place(np.array([[1.0, 0.0, 0.2]])), [[2.0, 2.5, 0.2]])


@given(turn_rad=st.floats(-7, 7))
def test_corners_run_counter_clockwise_however_turned(turn_rad: float) -> None:
    corners = rooms.Block("crate", WOOD, [1.0, 2.0], [3.0, 0.5, 1.0], turn_rad).corners_m
    after = np.roll(corners, -1, axis=0)
    area = 0.5 * np.sum(corners[:, 0] * after[:, 1] - corners[:, 1] * after[:, 0])
    assert area == pytest.approx(1.5)
    np.testing.assert_allclose(corners.mean(axis=0), [1.0, 2.0], atol=1e-12)


def test_a_shoebox_has_its_surfaces_where_they_were_named() -> None:
    names = ("door", "glass", "brick", "plaster", "carpet", "concrete")
    room = rooms.shoebox(np.array([6.0, 4.0, 2.5]), tuple(material(name) for name in names))
    middles = (room.outline_m + np.roll(room.outline_m, -1, axis=0)) / 2
    expected = {(0, 2): "door", (6, 2): "glass", (3, 0): "brick", (3, 4): "plaster"}
    for middle, wall in zip(middles, room.walls, strict=True):
        assert wall.name == expected[tuple(middle.astype(int))]
    assert (room.floor.name, room.ceiling.name) == ("carpet", "concrete")
    assert room.size_m.tolist() == [6.0, 4.0, 2.5]


def test_a_phone_is_free_above_a_table_and_below_a_lamp_but_not_within() -> None:
    table = rooms.box("table", [1.0, 1.0, 0.0], [1.0, 1.0, 0.7])
    lamp = rooms.box("lamp", [1.0, 1.0, 1.8], [1.0, 1.0, 0.3])
    room, place = ell(table, lamp), np.array([[1.5, 1.5]])
    assert [room.is_free(place, z).item() for z in (0.5, 1.2, 1.9, 2.3)] == [
        False, True, False, True,
    ]  # fmt: skip


def test_a_margin_is_kept_from_walls_and_turned_blocks() -> None:
    crate = rooms.Block("crate", WOOD, [1.5, 1.5], [1.0, 1.0, 2.0], np.pi / 4)
    room = ell(crate)
    places = np.array([[0.35, 1.5], [1.5 - 0.75, 1.5 - 0.35], [5.9, 1.0], [2.9, 3.5]])
    assert room.is_free(places, 1.0).tolist() == [True, True, True, True]
    assert room.is_free(places, 1.0, 0.3).tolist() == [True, False, False, False]


WALLS = (material("plaster"),) * 6
STOOL = rooms.box("stool", np.array([2.0, 1.0, 0.0]), np.array([1.0, 0.5, 0.5]))
LAMP = rooms.box("lamp", np.array([4.0, 1.0, 1.85]), np.array([1.0, 0.5, 0.5]))
ROOM = rooms.shoebox(np.array([6.0, 4.0, 2.5]), WALLS, (STOOL, LAMP))
ANGLE = rooms.Room(
    np.array([[0.0, 0], [4, 0], [4, 2], [2, 2], [2, 4], [0, 4]]), 2.5, WALLS, WALLS[0], WALLS[0]
)


def at(*xy: float) -> F64:
    return np.array(xy, dtype=np.float64)


def test_distances_in_plan() -> None:
    points = np.array([[0.0, 1.0], [1.5, -2.0], [5.0, 0.0]])
    assert rooms.point_gap_m(points, at(0, 0), at(2, 0)).tolist() == [1.0, 2.0, 3.0]
    assert rooms.segment_gap_m(at(0, 0), at(2, 0), at(0, 1), at(2, 3)) == 1.0
    assert rooms.segment_gap_m(at(0, 0), at(2, 0), at(1, -1), at(1, 1)) == 0.0


@pytest.mark.parametrize(
    ("y", "free"), [(0.74, True), (0.76, False), (1.2, False), (1.74, False), (1.76, True)]
)
def test_half_a_person_stays_off_the_stool(y: float, free: bool) -> None:
    way = np.array([[0.5, y], [5.5, y]])
    assert (rooms.fault_of_route(ROOM, way, closed=False) is None) is free
    assert rooms.standing_room(ROOM, at(2.5, y)[None])[0] == free
    assert (rooms.in_the_way(ROOM, *way) == '"stool"') is not free


@pytest.mark.parametrize(("x", "free"), [(0.24, False), (0.26, True), (5.74, True), (5.76, False)])
def test_half_a_person_stays_off_the_walls(x: float, free: bool) -> None:
    assert rooms.standing_room(ROOM, at(x, 3.0)[None])[0] == free
    assert (rooms.in_the_way(ROOM, at(x, 2.5), at(x, 3.0)) is None) is free


def test_what_hangs_above_the_head_is_no_obstacle() -> None:
    assert rooms.in_the_way(ROOM, at(4.5, 0.5), at(4.5, 3.5)) is None
    assert rooms.standing_room(ROOM, at(4.5, 1.2)[None])[0]


def test_a_corner_of_the_room_is_not_cut() -> None:
    assert rooms.in_the_way(ANGLE, at(3.5, 1.0), at(1.0, 3.5)) is not None
    assert rooms.in_the_way(ANGLE, at(3.5, 1.0), at(1.0, 1.0)) is None
    assert "outside" in str(rooms.in_the_way(ANGLE, at(1.0, 1.0), at(3.0, 3.0)))
    assert "(side 3)" in str(rooms.in_the_way(ANGLE, at(2.5, 1.8), at(3.5, 1.8)))


def test_a_closed_route_walks_home() -> None:
    around = np.array([[0.5, 0.5], [3.5, 0.5], [3.5, 2.0], [0.5, 2.0]])
    assert rooms.fault_of_route(ROOM, around, closed=True) is None
    through = np.array([[0.5, 1.2], [0.5, 3.0], [3.5, 3.0], [3.5, 1.2]])
    assert rooms.fault_of_route(ROOM, through, closed=False) is None
    assert "leg 4 (the one that closes it)" in str(rooms.fault_of_route(ROOM, through, closed=True))


def test_routes_that_lead_nowhere() -> None:
    place = np.array([[0.5, 0.5], [0.5, 0.5]])
    assert "fewer than 2 distinct corners" in str(rooms.fault_of_route(ROOM, place, closed=True))
    short = np.array([[0.5, 0.5], [1.4, 0.5]])
    assert "is 1.80 m long" in str(rooms.fault_of_route(ROOM, short, closed=True))
    assert "is 0.90 m long" in str(rooms.fault_of_route(ROOM, short, closed=False))


@given(turn_rad=st.floats(-3.0, 3.0), ends=st.tuples(*[st.floats(-3.0, 3.0)] * 4))
def test_a_turned_block_is_met_where_points_along_the_way_are_in_it(
    turn_rad: float, ends: tuple[float, ...]
) -> None:
    """Against dense points in a frame turned the other way; near misses are left out."""
    block = rooms.Block("b", WALLS[0], at(0.2, -0.1), at(1.6, 0.6, 1.0), turn_rad)
    a, b = at(*ends[:2]), at(*ends[2:])
    points = a + np.linspace(0, 1, 2001)[:, None] * (b - a) - block.centre_m
    cos, sin = np.cos(-turn_rad), np.sin(-turn_rad)
    local = points @ np.array([[cos, sin], [-sin, cos]])
    depth_m = float((np.abs(local) - [1.05, 0.55]).max(axis=1).min())
    if abs(depth_m) > 0.005:
        assert bool(rooms.meets_block(block, a[None], b[None])[0]) == (depth_m < 0)

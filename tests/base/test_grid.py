"""Ground in squares: the walked ones are free, and outlines hold exactly them."""

import tracemalloc

import numpy as np
import numpy.testing as npt
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from elfslam.base import grid as grids
from elfslam.base.arrays import F64
from elfslam.base.errors import InputError


def shape_of(polygon: tuple[F64, ...]) -> shapely.Polygon:
    return shapely.Polygon(polygon[0], polygon[1:])


def test_the_walked_ground_is_that_within_the_radius_of_the_line() -> None:
    line = np.array([[0.0, 0.0], [3.0, 1.0], [3.0, 4.0]])
    grid = grids.walked_grid([line], 0.3, 0.05)
    rows, columns = grid.free.shape
    x = grid.corner_m[0] + (np.arange(columns) + 0.5) * 0.05
    y = grid.corner_m[1] + (np.arange(rows) + 0.5) * 0.05
    gap = shapely.distance(shapely.LineString(line), shapely.points(*np.meshgrid(x, y)))
    assert grid.free[gap < 0.299].all()
    assert not grid.free[gap > 0.3].any()
    assert grid.holds(line).all()
    assert not grid.holds(np.array([[1.0, 2.0], [-50.0, 0.0], [0.0, 50.0]])).any()


def test_drawn_ground_is_the_polygons_less_what_blocks_them() -> None:
    square = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
    hole, table = square[::-1] / 4 + 2, square / 4 + 0.5
    grid = grids.drawn_grid([(square, hole), (square + 4,)], [(table,)], 0.1)
    asked = np.array([[0.2, 0.2], [5.0, 5.0], [2.5, 2.5], [1.0, 1.0], [5.0, 1.0], [-0.5, 1.0]])
    npt.assert_array_equal(grid.holds(asked), [1, 1, 0, 0, 0, 0])


def test_resampling_keeps_the_corners_and_the_spacing() -> None:
    line = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.05]])
    dense = grids.resampled(line, 0.3)
    npt.assert_allclose(dense[[0, 4, 5]], line)
    assert np.linalg.norm(np.diff(dense, axis=0), axis=1).max() <= 0.3


def test_a_ring_of_ground_has_a_hole() -> None:
    free = np.ones((5, 6), dtype=bool)
    free[2, 2:4] = False
    (polygon,) = grids.outlines(grids.FloorGrid(free, np.array([10.0, 20.0]), 0.5))
    assert [grids.signed_area(ring) > 0 for ring in polygon] == [True, False]
    middles = np.array([[10.25, 20.25], [11.25, 21.25]])
    npt.assert_array_equal(grids.in_polygon(polygon, middles), [True, False])


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 9))
def test_outlines_are_valid_and_hold_free_middles(seed: int, rows: int, columns: int) -> None:
    free = np.random.default_rng(seed).random((rows, columns)) < 0.6
    found = grids.outlines(grids.FloorGrid(free, np.zeros(2), 1.0))
    together = shapely.MultiPolygon([shape_of(polygon) for polygon in found])
    assert together.is_valid
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    held = shapely.contains_xy(together, x, y) if found else np.zeros_like(free)
    npt.assert_array_equal(held, free)


def test_squares_that_share_a_corner_alone_are_apart() -> None:
    assert len(grids.outlines(grids.FloorGrid(np.eye(2, dtype=bool), np.zeros(2), 1.0))) == 2


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_the_area_of_a_ring_has_the_sign_of_its_sense(turn: int) -> None:
    square = np.roll(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]), turn, axis=0)
    assert grids.signed_area(square) == pytest.approx(4.0)
    assert grids.signed_area(square[::-1]) == pytest.approx(-4.0)


def rings(corners: int) -> st.SearchStrategy[F64]:
    """Any corners in an order of their own: rings that cross themselves too."""
    places = st.floats(-3, 3).map(lambda value: round(value, 2))
    return st.lists(st.tuples(places, places), min_size=3, max_size=corners).map(np.array)


@given(st.lists(st.lists(rings(9), min_size=1, max_size=3).map(tuple), min_size=1, max_size=3))
def test_drawn_ground_is_what_each_middle_says_by_itself(polygons: list[tuple[F64, ...]]) -> None:
    cell_m = 0.1
    for ground, blocked in ((polygons, []), (polygons[:1], polygons[1:])):
        grid = grids.drawn_grid(ground, blocked, cell_m)
        rows, columns = grid.free.shape
        low = np.round(grid.corner_m / cell_m) + 0.5
        sides = [(low[0] + np.arange(columns)) * cell_m, (low[1] + np.arange(rows)) * cell_m]
        x, y = np.meshgrid(*sides)
        middles = np.column_stack([x.ravel(), y.ravel()])
        wanted = np.zeros(len(middles), dtype=bool)
        for polygon in ground:
            wanted |= grids.in_polygon(polygon, middles)
        for polygon in blocked:
            wanted &= ~grids.in_polygon(polygon, middles)
        npt.assert_array_equal(grid.free.ravel(), wanted)


def test_a_ring_of_many_corners_takes_memory_for_its_rows_alone() -> None:
    turn = np.linspace(0, 2 * np.pi, 50_000, endpoint=False)
    ring = 20 * np.column_stack([np.cos(turn), np.sin(turn)])
    tracemalloc.start()
    try:
        grid = grids.drawn_grid([(ring,)], [], 0.1)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert abs(grid.free.sum() * 0.01 - np.pi * 400) < 1
    assert peak < 50e6 < len(ring) * grid.free.size / 10


def test_ground_that_no_grid_can_hold_is_refused() -> None:
    square = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    with pytest.raises(InputError, match="squares, wanted at most"):
        grids.drawn_grid([(square * 1e6,)], [], 0.1)
    with pytest.raises(InputError, match="squares, wanted at most"):
        grids.walked_grid([np.array([[0.0, 0.0]]), np.array([[1e9, 1e9]])], 0.3, 0.05)
    with pytest.raises(InputError, match="on each other"):
        grids.drawn_grid([(square * 100,)] * 300, [], 0.05)


@pytest.mark.parametrize("limit", ["MOST_RINGS", "MOST_SIDES"])
def test_noise_has_no_outlines(monkeypatch: pytest.MonkeyPatch, limit: str) -> None:
    free = np.random.default_rng(0).uniform(size=(50, 50)) < 0.5
    noise = grids.FloorGrid(free, np.zeros(2), 0.1)
    assert len(grids.outlines(noise)) > 50
    monkeypatch.setattr(f"elfslam.base.grid.{limit}", 50)
    with pytest.raises(InputError, match="too ragged"):
        grids.outlines(noise)


def test_each_hole_lies_in_the_smallest_ring_about_it() -> None:
    free = np.ones((11, 11), dtype=bool)
    free[1:10, 1:10] = False
    free[2:9, 2:9] = True
    free[4:7, 4:7] = False
    free[5, 5] = True
    found = grids.outlines(grids.FloorGrid(free, np.zeros(2), 1.0))
    assert sorted(len(polygon) for polygon in found) == [1, 2, 2]
    for polygon in found:
        for hole in polygon[1:]:
            assert shapely.Polygon(polygon[0]).contains(shapely.Polygon(hole))


ELL_M = np.array([[0, 0], [6, 0], [6, 3], [3, 3], [3, 5], [0, 5]], dtype=float)


@pytest.mark.parametrize(
    ("xy_m", "expected"),
    [([1, 4], True), ([5, 1], True), ([4, 4], False), ([-1, 1], False), ([2.9, 3.1], True)],
)
def test_points_inside_a_ring(xy_m: list[float], expected: bool) -> None:
    assert grids.in_ring(ELL_M, np.array([xy_m], dtype=float)).tolist() == [expected]


def in_ell(points: F64) -> F64:
    x, y = points.T
    return (x > 0) & (y > 0) & (x < 6) & (y < 5) & ((x < 3) | (y < 3))


@given(turn_rad=st.floats(0.01, 6.27), shift_m=st.tuples(st.floats(-99, 99), st.floats(-99, 99)))
def test_inside_stays_inside_of_any_ring(turn_rad: float, shift_m: tuple[float, float]) -> None:
    points = np.random.default_rng(5).uniform([-1, -1], [7, 6], (200, 2))
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cos, sin], [-sin, cos]])
    found = grids.in_ring(ELL_M @ turn + shift_m, points @ turn + shift_m)
    assert (found == in_ell(points)).all()

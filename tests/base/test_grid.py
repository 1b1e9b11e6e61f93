"""Ground in squares: the walked ones are free, and outlines hold exactly them."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from elfslam.base.arrays import F64
from elfslam.base.grid import (
    FloorGrid,
    drawn_grid,
    in_polygon,
    outlines,
    resampled,
    signed_area,
    walked_grid,
)


def shape_of(polygon: tuple[F64, ...]) -> shapely.Polygon:
    return shapely.Polygon(polygon[0], polygon[1:])


def test_the_walked_ground_is_that_within_the_radius_of_the_line() -> None:
    line = np.array([[0.0, 0.0], [3.0, 1.0], [3.0, 4.0]])
    grid = walked_grid([line], 0.3, 0.05)
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
    grid = drawn_grid([(square, hole), (square + 4,)], [(table,)], 0.1)
    asked = np.array([[0.2, 0.2], [5.0, 5.0], [2.5, 2.5], [1.0, 1.0], [5.0, 1.0], [-0.5, 1.0]])
    npt.assert_array_equal(grid.holds(asked), [1, 1, 0, 0, 0, 0])


def test_resampling_keeps_the_corners_and_the_spacing() -> None:
    line = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 0.05]])
    dense = resampled(line, 0.3)
    npt.assert_allclose(dense[[0, 4, 5]], line)
    assert np.linalg.norm(np.diff(dense, axis=0), axis=1).max() <= 0.3


def test_a_ring_of_ground_has_a_hole() -> None:
    free = np.ones((5, 6), dtype=bool)
    free[2, 2:4] = False
    (polygon,) = outlines(FloorGrid(free, np.array([10.0, 20.0]), 0.5))
    assert [signed_area(ring) > 0 for ring in polygon] == [True, False]
    middles = np.array([[10.25, 20.25], [11.25, 21.25]])
    npt.assert_array_equal(in_polygon(polygon, middles), [True, False])


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 9), st.integers(1, 9))
def test_outlines_are_valid_and_hold_the_middles_of_free_squares(
    seed: int, rows: int, columns: int
) -> None:
    free = np.random.default_rng(seed).random((rows, columns)) < 0.6
    found = outlines(FloorGrid(free, np.zeros(2), 1.0))
    together = shapely.MultiPolygon([shape_of(polygon) for polygon in found])
    assert together.is_valid
    x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
    held = shapely.contains_xy(together, x, y) if found else np.zeros_like(free)
    npt.assert_array_equal(held, free)


def test_squares_that_share_a_corner_alone_are_apart() -> None:
    assert len(outlines(FloorGrid(np.eye(2, dtype=bool), np.zeros(2), 1.0))) == 2


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_the_area_of_a_ring_has_the_sign_of_its_sense(turn: int) -> None:
    square = np.roll(np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]]), turn, axis=0)
    assert signed_area(square) == pytest.approx(4.0)
    assert signed_area(square[::-1]) == pytest.approx(-4.0)

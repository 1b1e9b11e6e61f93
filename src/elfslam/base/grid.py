"""Ground in square cells: where somebody walked or can walk, and the outlines of that."""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Bool, Value, array

DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
"""East, north, west, south: one further is a turn to the left."""
BODY_RADIUS_M = 0.25
"""Half the width of a person."""

Polygon = tuple[F64, ...]
"""Rings (k, 2) in metres, not closed: the outer one counter-clockwise, then holes clockwise."""


@dataclass(frozen=True, eq=False)
class FloorGrid(Value):
    """Whether each square of the floor is free; row 0 lies lowest, column 0 leftmost.

    `corner_m` is the lower left corner of the first square.
    """

    free: Bool = array("r", "c", dtype=np.bool_)
    corner_m: F64 = array(2)
    cell_m: float

    def holds(self, xy_m: F64) -> Bool:
        """Whether each point (n, 2) lies on free ground; outside the grid it does not."""
        column, row = np.floor((xy_m - self.corner_m) / self.cell_m).astype(np.int64).T
        rows, columns = self.free.shape
        inside = (row >= 0) & (row < rows) & (column >= 0) & (column < columns)
        row, column = np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)
        return np.asarray(inside & self.free[row, column])


def resampled(line_m: F64, spacing_m: float) -> F64:
    """Points (m, 2) at most `spacing_m` apart along a line (n, 2), its own points included."""
    lengths = np.linalg.norm(np.diff(line_m, axis=0), axis=1)
    pieces = [line_m[:1]]
    for a, b, length in zip(line_m[:-1], line_m[1:], lengths, strict=True):
        count = max(int(np.ceil(length / spacing_m)), 1)
        pieces.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(pieces)


def walked_grid(lines_m: Sequence[F64], radius_m: float, cell_m: float) -> FloorGrid:
    """The squares whose middle lies within a radius of lines (each n, 2), a margin about them.

    The corner is a multiple of the cell, so that grids of one cell fit each other.
    """
    points = np.concatenate([resampled(line, cell_m / 2) for line in lines_m])
    margin_m = radius_m + cell_m
    low = np.floor((points.min(axis=0) - margin_m) / cell_m)
    high = np.ceil((points.max(axis=0) + margin_m) / cell_m)
    columns, rows = (high - low).astype(int)
    free = np.zeros((rows, columns), dtype=np.bool_)
    reach = int(np.ceil(radius_m / cell_m)) + 1
    around = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(around, around), axis=-1).reshape(-1, 2)
    place = points / cell_m - low
    cells = np.floor(place).astype(np.int64)
    for offset in offsets:
        reached = cells + offset
        gap = np.linalg.norm(reached + 0.5 - place, axis=1) * cell_m
        near = reached[gap <= radius_m]
        free[near[:, 1], near[:, 0]] = True
    return FloorGrid(free, low * cell_m, cell_m)


def drawn_grid(ground: Sequence[Polygon], blocked: Sequence[Polygon], cell_m: float) -> FloorGrid:
    """The squares whose middle lies on some polygon of the ground and on no blocked one."""
    corners = np.concatenate([polygon[0] for polygon in ground])
    low = np.floor(corners.min(axis=0) / cell_m) - 1
    columns, rows = (np.ceil(corners.max(axis=0) / cell_m) + 1 - low).astype(int)
    x, y = np.meshgrid(low[0] + 0.5 + np.arange(columns), low[1] + 0.5 + np.arange(rows))
    middles = np.column_stack([x.ravel(), y.ravel()]) * cell_m
    free = np.zeros(len(middles), dtype=np.bool_)
    for polygon in ground:
        free |= in_polygon(polygon, middles)
    for polygon in blocked:
        free &= ~in_polygon(polygon, middles)
    return FloorGrid(free.reshape(rows, columns), low * cell_m, cell_m)


def outlines(grid: FloorGrid) -> list[Polygon]:
    """The free ground as polygons, a polygon for each part that hangs together.

    Squares that share only a corner do not hang together. Rings run through the middles of the
    squares' sides, which cuts corners and keeps rings from touching themselves or each other.
    """
    rings = [grid.corner_m + ring * grid.cell_m for ring in _traced(grid.free)]
    outer = [ring for ring in rings if signed_area(ring) > 0]
    holes: list[list[F64]] = [[] for _ in outer]
    for hole in rings:
        if signed_area(hole) < 0:
            about = [k for k, ring in enumerate(outer) if in_ring(ring, hole[:1])[0]]
            holes[min(about, key=lambda k: signed_area(outer[k]))].append(hole)
    return [(ring, *inner) for ring, inner in zip(outer, holes, strict=True)]


def signed_area(ring: F64) -> float:
    """The area within a ring (k, 2), negative where it runs clockwise."""
    x, y = (ring - ring[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def in_ring(ring: F64, points: F64) -> Bool:
    """Whether points (n, 2) lie within a ring (k, 2), by how often a ray crosses it."""
    a, b = ring, np.roll(ring, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    spans = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(spans, b[:, 1] - a[:, 1], 1.0)
    crossing = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
    return np.asarray((spans & (x < crossing)).sum(axis=1) % 2 == 1)


def in_polygon(polygon: Polygon, points: F64) -> Bool:
    """Whether points (n, 2) lie within the outer ring and in none of the holes."""
    inside = in_ring(polygon[0], points)
    for hole in polygon[1:]:
        inside &= ~in_ring(hole, points)
    return inside


def _traced(free: Bool) -> list[F64]:
    """Rings in cells, free ground to the left."""
    sides = _sides(free)
    rings = []
    while sides:
        start = at = next(iter(sides))
        middles = []
        while at in sides:
            del sides[at]
            x, y, way = at
            step = DIRECTIONS[way]
            middles.append((x + step[0] / 2, y + step[1] / 2))
            x, y = x + int(step[0]), y + int(step[1])
            # The left turn first: it stays with the same square where two meet in a corner.
            turns = [(x, y, (way + turn) % 4) for turn in (1, 0, 3)]
            at = next((each for each in turns if each in sides), start)
        rings.append(_without_straights(np.array(middles)))
    return rings


def _sides(free: Bool) -> dict[tuple[int, int, int], None]:
    """The sides between free and other squares: where each starts and which way it leads."""
    padded = np.pad(free, 1)
    inner = padded[1:-1, 1:-1]
    beyond = (padded[:-2, 1:-1], padded[1:-1, 2:], padded[2:, 1:-1], padded[1:-1, :-2])
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    found: dict[tuple[int, int, int], None] = {}
    for way in range(4):
        rows, columns = np.nonzero(inner & ~beyond[way])
        starts: I64 = np.column_stack([columns, rows]) + corners[way]
        found.update(dict.fromkeys((int(x), int(y), way) for x, y in starts))
    return found


def _without_straights(ring: F64) -> F64:
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turns = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(ring[np.abs(turns) > 1e-9])

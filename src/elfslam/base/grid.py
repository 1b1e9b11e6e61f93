"""Occupancy grid: where somebody walked or can walk, and its outlines."""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Bool, Value, array
from elfslam.base.errors import InputError

DIRECTIONS = np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
"""East, north, west, south: one further is a turn to the left."""
BODY_RADIUS_M = 0.25
"""Half the width of a person."""

MOST_SQUARES = 100_000_000
"""Of a grid: 500 m by 500 m in squares of 5 cm."""
MOST_DRAWN = 1_000_000_000
"""Squares of the boxes about all rings: a plan lies on itself a few times, not a thousand."""
MOST_SIDES, MOST_RINGS = 1_000_000, 20_000
"""Of an outline: more is noise and no ground."""
CROSSINGS_AT_ONCE = 1_000_000

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

    The corner is a multiple of the cell, so that grids of one cell fit each other. Raises
    InputError where the lines lie too far apart for squares of that size.
    """
    points = np.concatenate([resampled(line, cell_m / 2) for line in lines_m])
    margin_m = radius_m + cell_m
    low = np.floor((points.min(axis=0) - margin_m) / cell_m)
    high = np.ceil((points.max(axis=0) + margin_m) / cell_m)
    free = _no_ground(high - low)
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
    """The squares whose middle lies on some polygon of the ground and on no blocked one.

    Raises InputError where they are too many, or lie on each other too often.
    """
    corners = np.concatenate([polygon[0] for polygon in ground])
    low = np.floor(corners.min(axis=0) / cell_m) - 1
    grid = FloorGrid(
        _no_ground(np.ceil(corners.max(axis=0) / cell_m) + 1 - low), low * cell_m, cell_m
    )
    free, rings = grid.free.copy(), [ring for polygon in (*ground, *blocked) for ring in polygon]
    drawn = sum(np.prod([side.stop - side.start for side in _box(grid, ring)]) for ring in rings)
    if drawn > MOST_DRAWN:
        raise InputError(
            f"the polygons lie on each other {drawn / free.size:.0f} times; keep one floor"
        )
    for polygon in ground:
        box = _box(grid, polygon[0])
        free[box] |= _drawn(grid, polygon)
    for polygon in blocked:
        box = _box(grid, polygon[0])
        free[box] &= ~_drawn(grid, polygon)
    return FloorGrid(free, grid.corner_m, cell_m)


def _no_ground(squares: F64) -> Bool:
    """A grid of so many columns and rows, none of it free. Raises InputError."""
    columns, rows = squares
    # NaN fails the comparison.
    if not columns * rows <= MOST_SQUARES:
        raise InputError(
            f"the ground needs {columns:.4g} by {rows:.4g} squares, wanted at most "
            f"{MOST_SQUARES:.1g}; make them larger, or take what lies far away out"
        )
    return np.zeros((int(rows), int(columns)), dtype=np.bool_)


def _box(grid: FloorGrid, ring: F64) -> tuple[slice, slice]:
    """Rows and columns of a grid that hold all squares with their middle within a ring."""
    columns_rows = np.array(grid.free.shape[::-1])
    first = np.floor((ring.min(axis=0) - grid.corner_m) / grid.cell_m) - 1
    last = np.ceil((ring.max(axis=0) - grid.corner_m) / grid.cell_m) + 1
    (left, low), (right, high) = np.clip([first, last], 0, columns_rows).astype(int).tolist()
    return slice(low, high), slice(left, right)


def _drawn(grid: FloorGrid, polygon: Polygon) -> Bool:
    """Which squares of the box about a polygon have their middle within it."""
    rows, columns = _box(grid, polygon[0])
    low = np.round(grid.corner_m / grid.cell_m) + 0.5
    x = (low[0] + np.arange(columns.start, columns.stop)) * grid.cell_m
    y = (low[1] + np.arange(rows.start, rows.stop)) * grid.cell_m
    inside = _in_rows(polygon[0], x, y)
    for hole in polygon[1:]:
        inside &= ~_in_rows(hole, x, y)
    return inside


def _in_rows(ring: F64, x: F64, y: F64) -> Bool:
    """`in_ring` for all points (rows, columns) of a grid, some rows after the other."""
    at_once = max(CROSSINGS_AT_ONCE // len(ring), 1)
    inside = np.zeros((len(y), len(x)), dtype=np.bool_)
    for first in range(0, len(y), at_once):
        row, crossing = _crossings(ring, y[first : first + at_once])
        part = inside[first : first + at_once]
        # A crossing turns the points left of it inside out.
        left = np.searchsorted(x, crossing) + row * (len(x) + 1)
        ends = np.bincount(left, minlength=len(part) * (len(x) + 1)).reshape(len(part), -1)
        part |= ends[:, :0:-1].cumsum(axis=1)[:, ::-1] % 2 == 1
    return inside


def _crossings(ring: F64, y: F64) -> tuple[I64, F64]:
    """Where horizontal lines cross a ring: which line (k), and the x there (k)."""
    a, b = ring, np.roll(ring, -1, axis=0)
    row, side = np.nonzero((a[:, 1] > y[:, None]) != (b[:, 1] > y[:, None]))
    a, b = a[side], b[side]
    return row, a[:, 0] + (y[row] - a[:, 1]) * (b[:, 0] - a[:, 0]) / (b[:, 1] - a[:, 1])


def outlines(grid: FloorGrid) -> list[Polygon]:
    """The free ground as polygons, a polygon for each part that hangs together.

    Squares that share only a corner do not hang together. Rings run through the middles of the
    squares' sides, which cuts corners and keeps rings from touching themselves or each other.
    Raises InputError where the ground is too ragged for any use of that.
    """
    rings = [grid.corner_m + ring * grid.cell_m for ring in _traced(grid.free)]
    if len(rings) > MOST_RINGS:
        raise _too_ragged(f"{len(rings)} rings")
    outer = [ring for ring in rings if signed_area(ring) > 0]
    holes: list[list[F64]] = [[] for _ in outer]
    smallest_first = np.argsort([signed_area(ring) for ring in outer], kind="stable")
    ends = np.array([(outer[k].min(axis=0), outer[k].max(axis=0)) for k in smallest_first])
    for hole in rings:
        if signed_area(hole) < 0:
            near = ((ends[:, 0] <= hole[0]) & (hole[0] <= ends[:, 1])).all(axis=1)
            about = (k for k in smallest_first[near] if in_ring(outer[k], hole[:1])[0])
            holes[next(about)].append(hole)
    return [(ring, *inner) for ring, inner in zip(outer, holes, strict=True)]


def _too_ragged(what: str) -> InputError:
    return InputError(f"the ground is too ragged, {what}; take out noise, or make it coarser")


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
        if len(found) + len(rows) > MOST_SIDES:
            raise _too_ragged(f"more than {MOST_SIDES} sides of squares")
        starts: I64 = np.column_stack([columns, rows]) + corners[way]
        found.update(dict.fromkeys((int(x), int(y), way) for x, y in starts))
    return found


def _without_straights(ring: F64) -> F64:
    before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
    turns = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(ring[np.abs(turns) > 1e-9])

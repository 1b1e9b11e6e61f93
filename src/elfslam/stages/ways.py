"""Ways through a building: the shortest path in time over walked ground and passages.

Dijkstra (1959) from the goal backwards on a directed graph. Its nodes are walked places, one of
each square, joined where they lie in reach of each other, and both ends of each passage. The page's
`stages/ways.js` is the same.
"""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from elfslam.base.arrays import F64, I64, Value, array
from elfslam.base.building import Passage
from elfslam.base.errors import InputError
from elfslam.base.values import LevelPassage

APART_M = 0.25
"""Walked places that lie closer together lead no further."""
REACH_M = 0.7
"""Less than from one side of a wall to the other: half a body on each, and the wall."""
JOINED_M = 5.0
"""A passage whose end lies further from walked ground is not joined to it."""
WALKING_MPS = 1.2
"""An adult's pace indoors (Bohannon 1997: 1.3 to 1.5 m/s out of doors)."""
LIFT_WAIT_S = 30.0
"""The mean wait that lifts of offices are planned for (CIBSE Guide D)."""

STRAIGHT_M = 1.0
"""Who strays less from a straight line has made no turn."""
TURNS = (
    "straight ahead", "half left", "left", "sharp left", "back", "sharp right", "right",
    "half right",
)  # fmt: skip
"""By eighths of a circle, counter-clockwise."""


@dataclass(frozen=True)
class LevelPosition:
    """A position on a floor."""

    level: int
    xy_m: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Leg(Value):
    """What of a way lies on one floor: a line (n, 2), and what leads from its end to the next."""

    level: int
    xy_m: F64 = array("n", 2)
    leaves_by: LevelPassage | None = None


@dataclass(frozen=True)
class Route:
    """Floor by floor from start to goal; passages count in `length_m` as seen from above."""

    legs: tuple[Leg, ...]
    length_m: float
    duration_s: float


@dataclass(frozen=True)
class Move:
    """Straight on for so far on a floor, after a turn, or else after a passage or the start."""

    level: int
    after: str
    length_m: float


@dataclass(frozen=True, eq=False)
class WayGraph(Value):
    """Walked places, then from `first_end` on the two ends of each passage.

    `seconds` (n, n) holds how long it takes from the node of the row to that of the column.
    """

    level: I64 = array("n", dtype=np.int64)
    xy_m: F64 = array("n", 2)
    first_end: int
    passages: tuple[Passage, ...]
    seconds: csr_array


def without_steps(passages: Sequence[Passage]) -> list[Passage]:
    """Passages for wheels: neither stairs nor escalators."""
    return [each for each in passages if each.kind is LevelPassage.LIFT]


def way_graph(walked_m: Mapping[int, F64], passages: Sequence[Passage]) -> WayGraph:
    """The graph of what was walked on each floor (places (n, 2) by level) and of its passages.

    Passages to floors without any are left out.
    """
    thinned = {level: _thinned(xy_m) for level, xy_m in walked_m.items() if len(xy_m)}
    used = tuple(each for each in passages if {each.from_level, each.to_level} <= thinned.keys())
    ends = [(level, *xy_m) for each in used for level, xy_m in _ends(each)]
    places = [np.column_stack([np.full(len(xy_m), k), xy_m]) for k, xy_m in thinned.items()]
    nodes = np.concatenate([*places, np.reshape(ends, (-1, 3))]) if places else np.empty((0, 3))
    level, xy_m = nodes[:, 0].astype(np.int64), nodes[:, 1:]
    first_end = len(nodes) - len(ends)
    walks = _walks(level, xy_m, first_end)
    rides = _rides(used, first_end)
    from_node, to_node, seconds = np.concatenate([walks, rides]).T
    edges = (from_node.astype(np.int64), to_node.astype(np.int64))
    size = (len(nodes), len(nodes))
    return WayGraph(level, xy_m, first_end, used, coo_array((seconds, edges), size).tocsr())


def way(graph: WayGraph, start: LevelPosition, goal: LevelPosition) -> Route | None:
    """The quickest way; None where no walk leads there. Raises InputError for an unwalked floor."""
    first, last = _nearest(graph, start), _nearest(graph, goal)
    ends_m = np.array([start.xy_m, goal.xy_m], dtype=np.float64)
    straight_m = float(np.linalg.norm(ends_m[1] - ends_m[0]))
    if start.level == goal.level and straight_m <= REACH_M:
        return Route((Leg(start.level, ends_m),), straight_m, straight_m / WALKING_MPS)
    away_s, following = dijkstra(graph.seconds.T, indices=last, return_predecessors=True)
    if not np.isfinite(away_s[first]):
        return None
    nodes = [first]
    while nodes[-1] != last:
        nodes.append(int(following[nodes[-1]]))
    beside_m = np.linalg.norm(graph.xy_m[[first, last]] - ends_m, axis=1).sum()
    line_m = np.vstack([ends_m[:1], graph.xy_m[nodes], ends_m[1:]])
    length_m = float(np.linalg.norm(np.diff(line_m, axis=0), axis=1).sum())
    duration_s = float(away_s[first] + beside_m / WALKING_MPS)
    return Route(_legs(graph, np.array(nodes), line_m), length_m, duration_s)


def moves_of(route: Route) -> list[Move]:
    """A way as one tells it: how far between which turns, and by which passages."""
    moves, after = [], "start"
    for leg in route.legs:
        sides = np.diff(corners(leg.xy_m, STRAIGHT_M), axis=0)
        bearing = np.arctan2(sides[:, 1], sides[:, 0])
        eighths = np.round(4 * np.diff(bearing) / np.pi).astype(np.int64) % 8
        turns = [after, *(TURNS[k] for k in eighths)]
        lengths_m = np.linalg.norm(sides, axis=1).tolist()
        moves += [Move(leg.level, *each) for each in zip(turns, lengths_m, strict=True)]
        after = leg.leaves_by or ""
    return moves


def corners(line_m: F64, off_m: float) -> F64:
    """The points of a line (n, 2) without those less than `off_m` off a straight between others.

    (Douglas and Peucker 1973.)
    """
    if len(line_m) < 3:
        return line_m
    along = line_m[-1] - line_m[0]
    share = (line_m - line_m[0]) @ along / max(float(along @ along), 1e-12)
    gap_m = np.linalg.norm(line_m - line_m[0] - np.clip(share, 0, 1)[:, None] * along, axis=1)
    at = int(gap_m.argmax())
    if gap_m[at] <= off_m:
        return line_m[[0, -1]]
    return np.vstack([corners(line_m[: at + 1], off_m)[:-1], corners(line_m[at:], off_m)])


def _ends(passage: Passage) -> list[tuple[int, tuple[float, float]]]:
    return [(passage.from_level, passage.from_xy_m), (passage.to_level, passage.to_xy_m)]


def _thinned(xy_m: F64) -> F64:
    """The first point in each square, in their order."""
    _, first = np.unique(np.floor(xy_m / APART_M), axis=0, return_index=True)
    return np.asarray(xy_m[np.sort(first)])


def _walks(level: I64, xy_m: F64, first_end: int) -> F64:
    """From, to and seconds (k, 3) between nodes in reach, and from ends to the nearest place."""
    pairs = [np.empty((0, 2), dtype=np.int64)]
    for each in np.unique(level):
        rows = np.flatnonzero(level == each)
        pairs.append(rows[KDTree(xy_m[rows]).query_pairs(REACH_M, output_type="ndarray")])
        places, ends = rows[rows < first_end], rows[rows >= first_end]
        far_m, near = KDTree(xy_m[places]).query(xy_m[ends])
        apart = (far_m > REACH_M) & (far_m <= JOINED_M)
        pairs.append(np.column_stack([ends[apart], places[near[apart]]]))
    one, other = np.concatenate(pairs).T
    seconds = np.linalg.norm(xy_m[one] - xy_m[other], axis=1) / WALKING_MPS
    there = np.column_stack([one, other, seconds])
    return np.concatenate([there, there[:, [1, 0, 2]]])


def _rides(passages: Sequence[Passage], first_end: int) -> F64:
    """From, to and seconds (k, 3) through passages; escalators lead one way."""
    rides = []
    for k, each in enumerate(passages):
        end, other = first_end + 2 * k, first_end + 2 * k + 1
        wait_s = LIFT_WAIT_S if each.kind is LevelPassage.LIFT else 0.0
        rides.append((end, other, each.duration_s + wait_s))
        if each.kind is not LevelPassage.ESCALATOR:
            rides.append((other, end, each.duration_s + wait_s))
    return np.reshape(np.array(rides, dtype=np.float64), (-1, 3))


def _nearest(graph: WayGraph, spot: LevelPosition) -> int:
    there = np.flatnonzero(graph.level == spot.level)
    if not len(there):
        known = ", ".join(map(str, np.unique(graph.level))) or "none"
        raise InputError(f"way: nothing was walked on level {spot.level}, wanted one of {known}")
    return int(there[np.linalg.norm(graph.xy_m[there] - spot.xy_m, axis=1).argmin()])


def _legs(graph: WayGraph, nodes: I64, line_m: F64) -> tuple[Leg, ...]:
    """The line from floor to floor: its first and last point lie beside the nodes."""
    level = graph.level[nodes]
    leaves = np.flatnonzero(np.diff(level))
    parts = np.split(line_m, leaves + 2)
    kinds = [graph.passages[(int(nodes[k]) - graph.first_end) // 2].kind for k in leaves]
    levels = level[[0, *(leaves + 1)]].tolist()
    return tuple(map(Leg, levels, parts, [*kinds, None]))

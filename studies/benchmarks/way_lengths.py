"""How right the phone's way to a named place is: its length, and the turn that it begins with.

    python -m studies.benchmarks.way_lengths [--pairs 200] [--seed 1]

In each world a walker's true footsteps are the walked ground, so that the error of maps stands
apart. Pairs of places beside that ground are drawn; the reference is the shortest way for a person
through the drawn room (Dijkstra over a grid of 0.1 m, with knight's moves), which knows walls and
furniture. `between` is how often it lies between what is told: the straight line, which is the
plain rival, and the way along walked ground. Needs node.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from elfslam.app.console import print_rows
from elfslam.base.arrays import F64
from elfslam.base.geometry import interpolate_poses, path_length_m
from elfslam.world.room import Room, standing_room
from elfslam.world.simulate import load_world, simulate

WORLDS = ("studio", "living_room", "office", "mall")
CELL_M = 0.1
EVERY_S = 0.2
BESIDE_M = 0.5
"""Named places and walkers lie this far beside the walked ground at most."""
AHEAD_M = 2.0
APART_M = 3.0
WRONG_RAD = np.deg2rad(67.5)
"""More than one and a half of the eight words off."""
GRID = 0.03
"""So much longer than straight ways those over the grid may be."""
MOVES = ((1, 0), (0, 1), (1, 1), (1, -1), (2, 1), (1, 2), (2, -1), (1, -2))
SCRIPT = Path(__file__).with_suffix(".mjs")


class Ground:
    """Where a person can stand, as a graph of cells, and the ways through it."""

    def __init__(self, room: Room) -> None:
        across = [np.arange(low, low + size, CELL_M)
                  for low, size in zip(room.corner_m, room.size_m[:2], strict=True)]  # fmt: skip
        cells = np.stack(np.meshgrid(*across, indexing="ij"), axis=-1)
        free = standing_room(room, cells.reshape(-1, 2)).reshape(cells.shape[:2])
        number = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
        self.xy_m, self.tree = cells[free], cKDTree(cells[free])
        edges = [self._edges(number, move) for move in MOVES]
        one, other, far_m = (np.concatenate(each) for each in zip(*edges, strict=True))
        size = (len(self.xy_m),) * 2
        self.links = coo_matrix((far_m, (one, other)), shape=size).tocsr()

    @staticmethod
    def _edges(number: Any, move: tuple[int, int]) -> tuple[Any, Any, Any]:
        moved = np.full_like(number, -1)
        (dx, dy), (rows, columns) = move, number.shape
        low, high = max(0, -dy), columns - max(0, dy)
        moved[: rows - dx, low:high] = number[dx:, low + dy : high + dy]
        linked = (number >= 0) & (moved >= 0)
        far_m = np.full(linked.sum(), CELL_M * np.hypot(dx, dy))
        return number[linked], moved[linked], far_m

    def way(self, start_m: F64, goal_m: F64) -> F64:
        """The cells (n, 2) of the shortest way; none where there is no way."""
        first, last = self.tree.query(np.stack([start_m, goal_m]))[1]
        far_m, before = dijkstra(
            self.links, directed=False, indices=first, return_predecessors=True
        )
        if not np.isfinite(far_m[last]):
            return np.empty((0, 2))
        cells = [last]
        while cells[-1] != first:
            cells.append(before[cells[-1]])
        return np.asarray(self.xy_m[cells[::-1]])


def point_along(line_m: F64, far_m: float) -> F64:
    """The point so far along a line, or its end."""
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line_m, axis=0), axis=1))])
    return np.array([np.interp(far_m, along_m, axis) for axis in line_m.T])


def angle_between(at_m: F64, one_m: F64, other_m: F64) -> float:
    a, b = one_m - at_m, other_m - at_m
    return float(np.abs(np.arctan2(a[0] * b[1] - a[1] * b[0], a @ b)))


def measured(name: str, pairs: int, seed: int) -> dict[str, object]:
    """The row of a world."""
    world = load_world(name)
    _, truth = simulate(world, seed, rounds=2, sound=False)
    t_s = np.arange(truth.t_s[0], truth.t_s[-1], EVERY_S)
    spots = interpolate_poses(truth.t_s, truth.world_from_body, t_s)[:, :2]
    ground, generator = Ground(world.room), np.random.default_rng([seed, 7])
    near = ground.xy_m[cKDTree(spots).query(ground.xy_m)[0] <= BESIDE_M]
    drawn = near[generator.integers(0, len(near), (4 * pairs, 2))]
    drawn = drawn[np.linalg.norm(drawn[:, 0] - drawn[:, 1], axis=1) > APART_M][:pairs]
    told = in_node(spots, drawn)
    ratios: dict[str, list[float]] = {"way": [], "line": []}
    turns: dict[str, list[float]] = {"way": [], "line": []}
    for (start, goal), way in zip(drawn, told, strict=True):
        best = ground.way(start, goal)
        if way is None or not len(best):
            continue
        best_m, ahead = path_length_m(best), point_along(best, AHEAD_M)
        straight_m = float(np.linalg.norm(goal - start))
        for kind, far_m, to in (("way", way["length_m"], np.array(way["ahead"])),
                                ("line", straight_m, goal)):  # fmt: skip
            ratios[kind].append(far_m / best_m)
            turns[kind].append(angle_between(start, to, ahead))
    row: dict[str, object] = {"world": name, "pairs": len(ratios["way"]),
                              "no way": sum(each is None for each in told)}  # fmt: skip
    least, most = np.array(ratios["line"]), np.array(ratios["way"])
    row["between"] = f"{np.mean((least <= 1 + GRID) & (most >= 1 - GRID)):.0%}"
    for kind, shares in ratios.items():
        low, middle, high = np.quantile(shares, (0.05, 0.5, 0.95))
        wrong = float(np.mean(np.array(turns[kind]) > WRONG_RAD))
        row[f"{kind} / shortest"] = f"{middle:.2f} ({low:.2f}-{high:.2f})"
        row[f"{kind}, wrong turn"] = f"{wrong:.0%}"
    return row


def in_node(spots: F64, pairs: F64) -> list[Any]:
    """What the phone's modules say of each pair."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "given.json"
        given = {"spots": spots.tolist(), "pairs": pairs.tolist(), "ahead": AHEAD_M}
        file.write_text(json.dumps(given))
        done = subprocess.run(["node", str(SCRIPT), str(file)], check=True, capture_output=True)
    found: list[Any] = json.loads(done.stdout)
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--pairs", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    known = parser.parse_args()
    rows = [measured(name, known.pairs, known.seed) for name in WORLDS]
    print_rows(rows, title="The way to a named place", as_json=known.json)


if __name__ == "__main__":
    main()

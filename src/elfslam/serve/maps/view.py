"""What the viewer draws of a map: walks, closures and coverage, few enough to be sent at once."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError, StoreError
from elfslam.base.values import FloorMap
from elfslam.data.map_exports import sigma_m, walk_lines
from elfslam.data.map_files import MERGED, QUALITY, TRAJECTORIES, is_merged, read_facts, read_map
from elfslam.data.npz import read_npz
from elfslam.data.position_files import read_tum
from elfslam.data.tables import read_lines, read_table

MOST_POINTS = 20_000
"""Of all walks together, and of all dead reckoning: two hours are 14,400 footsteps."""
MOST_CLOSURES = 8_000
MOST_CELLS = 40_000
CELL_M = 1.0
KEPT_WEIGHT = 0.5

Json = dict[str, Any]


def view_of(folder: Path) -> Json:
    """What is drawn of a run folder or of a folder of a merged map.

    `walks` and `dead_reckoning` are lines (`t_s` is empty where only places are known, `sigma_m`
    per axis), `closures` are those that hold, `coverage` tells square by square how many walks
    passed (`walks`) and how sure their places are (`sigma_m`, null where nobody passed). Lengths
    are in metres, to a millimetre. Raises StoreError where a file is missing or damaged.
    """
    try:
        return _floor_view(folder) if is_merged(folder) else _run_view(folder)
    except (InputError, ValueError, TypeError, LookupError) as cause:
        raise StoreError(f"{folder}: is no whole map ({cause}); make it again") from cause


def _run_view(folder: Path) -> Json:
    name = str(read_facts(folder).get("name", folder.name))
    t_s, poses = read_tum(folder / "trajectory.tum")
    _, reckoned = read_tum(folder / "odometry.tum")
    covariance = read_npz(folder / "uncertainty.npz", ["trajectory_covariance"])
    variance_m2 = np.trace(covariance["trajectory_covariance"][:, :2, :2], axis1=1, axis2=2) / 2
    sigma = np.sqrt(variance_m2)
    xy_m = poses[:, :2]
    return {
        "kind": "run",
        "bounds_m": _bounds(xy_m),
        "walks": [_walk(name, t_s, xy_m, sigma, MOST_POINTS)],
        "dead_reckoning": [
            {"name": name, "xy_m": _rounded(_thinned(reckoned[:, :2], MOST_POINTS))}
        ],
        "closures": _rounded(_thinned(_closures(folder / "closures.csv", xy_m), MOST_CLOSURES)),
        "coverage": _coverage(xy_m, np.ones(len(xy_m)), sigma, CELL_M),
    }


def _floor_view(folder: Path) -> Json:
    floor_map = read_map(folder)
    names = list(floor_map.sources)
    lines = [line for k, name in enumerate(names) for line in _lines(folder, floor_map, k, name)]
    most = MOST_POINTS // max(len(lines), 1)
    facts = json.loads((folder / MERGED).read_text(encoding="utf-8"))
    cells = read_table(folder / QUALITY, ("x_m", "y_m", "walks", "sigma_m"))
    cell_m = float(facts["parameters"]["quality"]["cell_m"])
    return {
        "kind": "floor",
        "bounds_m": _bounds(floor_map.xy_m),
        "walks": [_walk(*line, most) for line in lines],
        "dead_reckoning": [],
        "closures": [],
        "coverage": _coverage(cells[:, :2], cells[:, 2], cells[:, 3], cell_m),
    }


def _lines(
    folder: Path, floor_map: FloorMap, walk: int, name: str
) -> list[tuple[str, F64, F64, F64]]:
    """Name, times, places and sigmas of a walk: its trajectory, or its spots where that is lost.

    A map that was grown keeps the trajectories of the walks that came last alone.
    """
    rows = floor_map.walk == walk
    if not rows.any():
        return []
    spots = cKDTree(floor_map.xy_m[rows])
    sigmas = sigma_m(floor_map)[rows]
    file = folder / TRAJECTORIES / f"{name.replace('/', '-')}.tum"
    if file.is_file():
        t_s, poses = read_tum(file)
        found = [(t_s, poses[:, :2])]
    else:
        found = [(np.empty(0), line) for each, line in walk_lines(floor_map) if each == walk]
    return [(name, t_s, xy_m, sigmas[spots.query(xy_m)[1]]) for t_s, xy_m in found]


def _walk(name: str, t_s: F64, xy_m: F64, sigma: F64, most: int) -> Json:
    return {
        "name": name,
        "t_s": np.round(_thinned(t_s, most), 2).tolist(),
        "xy_m": _rounded(_thinned(xy_m, most)),
        "sigma_m": _rounded(_thinned(sigma, most)),
    }


def _closures(file: Path, xy_m: F64) -> F64:
    """Both ends (k, 4) of the closures that hold."""
    if len(read_lines(file)) == 1:
        return np.empty((0, 4))
    table = read_table(file, ("i", "j", "weight"))
    i, j = table[table[:, 2] > KEPT_WEIGHT, :2].astype(int).T
    return np.hstack([xy_m[i], xy_m[j]])


def _coverage(xy_m: F64, walks: F64, sigma: F64, cell_m: float) -> Json | None:
    """The most walks that pass, and the root mean square of the sigmas, square by square."""
    if not len(xy_m):
        return None
    span_m = np.ptp(xy_m, axis=0)
    while np.prod(span_m // cell_m + 2) > MOST_CELLS:
        cell_m *= 2
    corner = np.floor(xy_m.min(axis=0) / cell_m)
    column, row = (np.floor(xy_m / cell_m) - corner).astype(int).T
    shape = int(row.max()) + 1, int(column.max()) + 1
    most, count, square = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    np.maximum.at(most, (row, column), walks)
    np.add.at(count, (row, column), 1)
    np.add.at(square, (row, column), sigma**2)
    mean = np.sqrt(square / np.maximum(count, 1))
    return {
        "corner_m": _rounded(corner * cell_m),
        "cell_m": cell_m,
        "shape": list(shape),
        "walks": most.astype(int).tolist(),
        "sigma_m": [
            [round(value, 3) if known else None for value, known in zip(*pair, strict=True)]
            for pair in zip(mean.tolist(), (count > 0).tolist(), strict=True)
        ],
    }


def _bounds(xy_m: F64) -> list[float]:
    return _rounded(np.concatenate([xy_m.min(axis=0), xy_m.max(axis=0)]))


def _thinned(rows: F64, most: int) -> F64:
    """At most so many rows, evenly chosen, the first and the last among them."""
    if len(rows) <= most:
        return rows
    return np.asarray(rows[np.linspace(0, len(rows) - 1, max(most, 2)).round().astype(int)])


def _rounded(metres: F64 | Sequence[float]) -> list[Any]:
    return list(np.round(np.asarray(metres, dtype=np.float64), 3).tolist())

"""How far a map can be trusted, square metre by square metre."""

# mypy takes every call on the right of a field for a default.
# mypy: disable-error-code="misc"

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, I64, Bool, Value, array
from elfslam.base.parameters import parameter
from elfslam.base.values import FloorMap

BLOCK_ROWS = 512


@dataclass(frozen=True)
class QualityParameters:
    """How the quality of a map is told."""

    cell_m: float = parameter(1.0, "m", "side of a square that is judged", 0.1, 100.0)
    asked: int = parameter(4000, "", "spots that are looked for in the map", 1, 10**6)


@dataclass(frozen=True, eq=False)
class MapQuality(Value):
    """Squares (c) that hold spots: their middle, walks and spots in them, and how good they are.

    `weight` is the mean of the spots', `sigma_m` the root mean square per axis of their positions.
    `error_m` is the median distance at which other walks are most similar, NaN where no other
    walk is near. `changed` is where the surroundings have changed since most spots were made.
    """

    xy_m: F64 = array("c", 2)
    walks: I64 = array("c", dtype=np.int64)
    spots: I64 = array("c", dtype=np.int64)
    weight: F64 = array("c")
    sigma_m: F64 = array("c")
    error_m: F64 = array("c", finite=False)
    changed: Bool = array("c", dtype=np.bool_)


def map_quality(floor_map: FloorMap, parameters: QualityParameters) -> MapQuality:
    """The quality of a map, square by square, those without a spot left out."""
    corners = np.floor(floor_map.xy_m / parameters.cell_m).astype(np.int64)
    cells, cell = np.unique(corners, axis=0, return_inverse=True)
    cell = np.asarray(cell).reshape(-1)
    spots = np.bincount(cell, minlength=len(cells))
    variance_m2 = np.trace(floor_map.covariance_m2, axis1=1, axis2=2) / 2
    visits = np.unique(np.column_stack([cell, floor_map.walk]), axis=0)

    def mean(values: F64) -> F64:
        return np.bincount(cell, values, minlength=len(cells)) / spots

    return MapQuality(
        xy_m=np.asarray((cells + 0.5) * parameters.cell_m, dtype=np.float64),
        walks=np.bincount(visits[:, 0], minlength=len(cells)),
        spots=spots,
        weight=mean(floor_map.weight),
        sigma_m=np.sqrt(mean(variance_m2)),
        error_m=_error_m(floor_map, cell, len(cells), parameters),
        changed=mean(floor_map.changed.astype(np.float64)) > 0.5,
    )


def _error_m(floor_map: FloorMap, cell: I64, cells: int, parameters: QualityParameters) -> F64:
    """The median error (c) of finding each square's spots by what the other walks sound like."""
    elf = next((item.vectors for item in floor_map.payloads if item.kind == "elf"), None)
    median_m = np.full(cells, np.nan)
    if elf is None or len(np.unique(floor_map.walk)) < 2:
        return median_m
    count = len(elf)
    asked = np.unique(np.linspace(0, count - 1, min(parameters.asked, count)).astype(int))
    nearest = np.empty(len(asked), dtype=np.int64)
    for first in range(0, len(asked), BLOCK_ROWS):
        rows = asked[first : first + BLOCK_ROWS]
        scores = elf[rows] @ elf.T
        scores[floor_map.walk[rows][:, None] == floor_map.walk] = -np.inf
        nearest[first : first + len(rows)] = scores.argmax(axis=1)
    off_m = np.linalg.norm(floor_map.xy_m[asked] - floor_map.xy_m[nearest], axis=1)
    for one in np.unique(cell[asked]):
        median_m[one] = np.median(off_m[cell[asked] == one])
    return median_m

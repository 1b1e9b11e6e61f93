"""Maps of many walks on disk: a folder that `elfslam locate` and `elfslam merge` read."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import FloorMap, PointOfInterest, Trajectory
from elfslam.data.facts import ENCODER, read_object
from elfslam.data.map_files import MAP, write_map
from elfslam.data.points_of_interest_files import write_points
from elfslam.data.tum import read_tum, write_tum
from elfslam.stages.floormap import MapQuality

MERGED = "merge.json"
QUALITY = "quality.csv"
SUPERIMPOSED = "superimposed"
TRAJECTORIES = "trajectories"
QUALITY_COLUMNS = (
    "x_m", "y_m", "walks", "spots", "weight", "sigma_m", "error_m", "changed"
)  # fmt: skip


def is_merged(path: Path) -> bool:
    """Whether a folder holds a map of many walks."""
    return (path / MERGED).is_file()


def is_superimposed(path: Path) -> bool:
    """Whether a folder holds a map of one spot for all headings, so that its own say nothing."""
    return is_merged(path) and read_object(path / MERGED).get(SUPERIMPOSED) is True


def walk_in(path: Path, name: str) -> tuple[F64, F64]:
    """Times (n) and poses (n, 3) of a walk in a merged map, in its frame.

    Raises InputError where the map does not hold them.
    """
    file = path / TRAJECTORIES / f"{name.replace('/', '-')}.tum"
    if not file.is_file():
        raise InputError(f"{path}: has no trajectory of {name}; merge its runs anew, all at once")
    return read_tum(file)


def fill_merged(
    folder: Path,
    floor_map: FloorMap,
    quality: MapQuality,
    trajectories: Mapping[str, Trajectory],
    *,
    facts: Mapping[str, object],
    encoder: bytes | None,
    points_of_interest: Sequence[PointOfInterest] = (),
) -> None:
    """Into a folder that is there: map.npz, quality.csv, trajectories, and what the facts say."""
    write_map(floor_map, folder / MAP)
    write_quality(quality, folder / QUALITY)
    (folder / TRAJECTORIES).mkdir()
    for name, walk in trajectories.items():
        file = folder / TRAJECTORIES / f"{name.replace('/', '-')}.tum"
        write_tum(file, walk.t_s, walk.world_from_body)
    text = json.dumps(dict(facts), indent=2, ensure_ascii=False, default=str)
    (folder / MERGED).write_text(text + "\n", encoding="utf-8")
    if encoder is not None:
        (folder / ENCODER).write_bytes(encoder)
    if points_of_interest:
        write_points(points_of_interest, folder)


def write_quality(quality: MapQuality, file: Path) -> None:
    """A row per square metre that holds spots; an error that nobody knows stays empty."""
    counts = [quality.walks, quality.spots]
    metres = [quality.weight, quality.sigma_m, quality.error_m, quality.changed]
    table = np.column_stack([quality.xy_m, *counts, *metres])
    rows = [",".join("" if np.isnan(value) else f"{value:.9g}" for value in row) for row in table]
    file.write_text("\n".join([",".join(QUALITY_COLUMNS), *rows]) + "\n", encoding="utf-8")

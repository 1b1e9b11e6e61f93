"""The points of interest of a map: points_of_interest.csv, in a run's folder or a map's."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from pathlib import Path

from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.values import PointKind, PointOfInterest
from elfslam.data.tables import read_named_rows

POINTS_OF_INTEREST = "points_of_interest.csv"
COLUMNS = ("name", "kind", "x_m", "y_m")
LONGEST_NAME = 80
MOST = 1_000
"""Named by hand, one by one."""


def write_points(points: Sequence[PointOfInterest], folder: Path) -> None:
    """The table of a map's points of interest, into `folder`."""
    (folder / POINTS_OF_INTEREST).write_text(points_as_csv(points), encoding="utf-8")


def points_as_csv(points: Sequence[PointOfInterest]) -> str:
    """The same table as a text, to a millimetre."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(COLUMNS)
    for each in points:
        writer.writerow([each.name, each.kind, f"{each.x_m:.3f}", f"{each.y_m:.3f}"])
    return stream.getvalue()


def read_points(folder: Path) -> tuple[PointOfInterest, ...]:
    """The points of interest of a map; none where there is no table. Raises InputError."""
    file = folder / POINTS_OF_INTEREST
    return read_points_file(file) if file.is_file() else ()


def read_points_file(file: Path) -> tuple[PointOfInterest, ...]:
    """The points of interest in a table, in its order. Raises InputError naming file and row."""
    rows = read_named_rows(file, COLUMNS)
    if len(rows) > MOST:
        raise InputError(f"{file}: has {len(rows)} points, wanted at most {MOST}; leave some out")
    return tuple(_point(f"{file}: row {k}", row) for k, row in enumerate(rows, start=2))


def _point(where: str, row: dict[str, str]) -> PointOfInterest:
    name, kind = row["name"].strip(), row["kind"].strip()
    if not 0 < len(name) <= LONGEST_NAME:
        raise InputError(
            f"{where} has a name of {len(name)} characters, wanted 1 to {LONGEST_NAME}; "
            "give each place a short name"
        )
    if kind not in list(PointKind):
        raise InputError(
            f"{where} has kind {kind!r:.30}, wanted {', '.join(PointKind)}; name one of these"
        )
    return PointOfInterest(name, PointKind(kind), _metres(where, row["x_m"]),
                           _metres(where, row["y_m"]))  # fmt: skip


def _metres(where: str, cell: str) -> float:
    try:
        metres = float(cell)
    except ValueError:
        metres = math.nan
    if not abs(metres) <= FARTHEST_M:
        raise InputError(f"{where} has {cell!r:.30}, wanted metres up to {FARTHEST_M:g}; repair it")
    return metres

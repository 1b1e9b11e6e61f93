"""Places with names as CSV: a map's points of interest, and when a walker was at checkpoints."""

import csv
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.values import Checkpoints, PointKind, PointOfInterest
from elfslam.data.tables import check_size, number_or_nan, read_named_rows

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
    name, kind = _name(where, row["name"]), row["kind"].strip()
    if kind not in list(PointKind):
        raise InputError(
            f"{where} has kind {kind!r:.30}, wanted {', '.join(PointKind)}; name one of these"
        )
    x_m, y_m = (_metres(where, row[column]) for column in ("x_m", "y_m"))
    return PointOfInterest(name, PointKind(kind), x_m, y_m)


def _metres(where: str, cell: str) -> float:
    metres = number_or_nan(cell)
    if not abs(metres) <= FARTHEST_M:
        raise InputError(f"{where} has {cell!r:.30}, wanted metres up to {FARTHEST_M:g}; repair it")
    return metres


CHECKPOINTS = "checkpoints.csv"
CHECKPOINT_COLUMNS = ("t_s", "name")
ON_PLAN = ("x_m", "y_m")
"""Empty where a place was named and not tapped; the columns may be left out."""
LONGEST_S = 1e6


def write_checkpoints(checkpoints: Checkpoints, folder: Path) -> None:
    """The table of a recording, into `folder`."""
    with (folder / CHECKPOINTS).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        xy_m = checkpoints.xy_m
        writer.writerow(CHECKPOINT_COLUMNS if xy_m is None else CHECKPOINT_COLUMNS + ON_PLAN)
        for k, (t_s, name) in enumerate(zip(checkpoints.t_s, checkpoints.names, strict=True)):
            tapped = [] if xy_m is None else ["" if np.isnan(v) else f"{v:.3f}" for v in xy_m[k]]
            writer.writerow([f"{t_s:.3f}", name, *tapped])


def read_checkpoints(folder: Path) -> Checkpoints | None:
    """The checkpoints of a recording in order of time; None where nobody made any.

    Raises InputError naming file and row.
    """
    file = folder / CHECKPOINTS
    if not file.is_file():
        return None
    rows = read_named_rows(file, CHECKPOINT_COLUMNS)
    if len(rows) > MOST:
        raise InputError(f"{file}: has {len(rows)} checkpoints, wanted at most {MOST}; leave some")
    placed = [(f"{file}: row {k}", row) for k, row in enumerate(rows, start=2)]
    t_s = np.array([_seconds(where, row["t_s"]) for where, row in placed])
    names = [_name(where, row["name"]) for where, row in placed]
    xy_m = np.array([_tapped(where, row) for where, row in placed]).reshape(-1, 2)
    check_size(file, t_s[:, None], LONGEST_S, "s")
    check_size(file, np.nan_to_num(xy_m), FARTHEST_M, "m")
    order = np.argsort(t_s, kind="stable")
    if (again := np.diff(t_s[order]) <= 0).any():
        twice_s = t_s[order][1:][again][0]
        raise InputError(f"{file}: two checkpoints at {twice_s:.3f} s; give each a time of its own")
    tapped = None if np.isnan(xy_m).all() else xy_m[order]
    return Checkpoints(t_s[order], tuple(names[k] for k in order), tapped)


def _seconds(where: str, cell: str) -> float:
    t_s = number_or_nan(cell)
    if not np.isfinite(t_s):
        raise InputError(f"{where} has time {cell!r:.30}, wanted seconds; repair it")
    return t_s


def _tapped(where: str, cells: dict[str, str]) -> list[float]:
    told = [(cells.get(column) or "").strip() for column in ON_PLAN]
    xy_m = [number_or_nan(cell) for cell in told]
    if any(told) and not np.isfinite(xy_m).all():
        raise InputError(
            f"{where} has x_m, y_m {','.join(told)!r:.40}, wanted metres for both or for none; "
            "repair it"
        )
    return xy_m


def _name(where: str, cell: str) -> str:
    name = (cell or "").strip()
    if not 0 < len(name) <= LONGEST_NAME:
        raise InputError(
            f"{where} has a name of {len(name)} characters, wanted 1 to {LONGEST_NAME}; "
            "give each place a short name"
        )
    return name

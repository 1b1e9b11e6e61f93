"""When the walker was at places that they gave a name, or tapped on a plan: checkpoints.csv."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.values import Checkpoints
from elfslam.data.tables import check_size, read_named_rows

CHECKPOINTS = "checkpoints.csv"
COLUMNS = ("t_s", "name")
ON_PLAN = ("x_m", "y_m")
"""Empty where a place was named and not tapped; the columns may be left out."""
LONGEST_S = 1e6
LONGEST_NAME = 80
MOST = 1_000
"""Tapped by hand, one by one."""


def write_checkpoints(checkpoints: Checkpoints, folder: Path) -> None:
    """The table of a recording, into `folder`."""
    with (folder / CHECKPOINTS).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        xy_m = checkpoints.xy_m
        writer.writerow(COLUMNS if xy_m is None else COLUMNS + ON_PLAN)
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
    rows = read_named_rows(file, COLUMNS)
    if len(rows) > MOST:
        raise InputError(f"{file}: has {len(rows)} checkpoints, wanted at most {MOST}; leave some")
    t_s = np.array([_seconds(file, k, row["t_s"]) for k, row in enumerate(rows, start=2)])
    names = [_name(file, k, row["name"]) for k, row in enumerate(rows, start=2)]
    xy_m = np.array([_tapped(file, k, row) for k, row in enumerate(rows, start=2)]).reshape(-1, 2)
    check_size(file, t_s[:, None], LONGEST_S, "s")
    check_size(file, np.nan_to_num(xy_m), FARTHEST_M, "m")
    order = np.argsort(t_s, kind="stable")
    if (again := np.diff(t_s[order]) <= 0).any():
        twice_s = t_s[order][1:][again][0]
        raise InputError(f"{file}: two checkpoints at {twice_s:.3f} s; give each a time of its own")
    tapped = None if np.isnan(xy_m).all() else xy_m[order]
    return Checkpoints(t_s[order], tuple(names[k] for k in order), tapped)


def _seconds(file: Path, row: int, cell: str) -> float:
    try:
        t_s = float(cell)
    except ValueError:
        t_s = np.nan
    if not np.isfinite(t_s):
        raise InputError(f"{file}: row {row} has time {cell!r:.30}, wanted seconds; repair it")
    return t_s


def _tapped(file: Path, row: int, cells: dict[str, str]) -> list[float]:
    """Where on the plan a place was tapped; NaN where it was not."""
    told = [(cells.get(column) or "").strip() for column in ON_PLAN]
    if not any(told):
        return [np.nan, np.nan]
    try:
        xy_m = [float(cell) for cell in told]
    except ValueError:
        xy_m = [np.nan]
    if not np.isfinite(xy_m).all():
        raise InputError(
            f"{file}: row {row} has x_m, y_m {','.join(told)!r:.40}, wanted metres for both or "
            "for none; repair it"
        )
    return xy_m


def _name(file: Path, row: int, cell: str) -> str:
    name = (cell or "").strip()
    if not 0 < len(name) <= LONGEST_NAME:
        raise InputError(
            f"{file}: row {row} has a name of {len(name)} characters, wanted 1 to {LONGEST_NAME}; "
            "give each place a short name"
        )
    return name

"""When the walker was at places that they gave a name: checkpoints.csv."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from elfslam.base.errors import InputError
from elfslam.base.values import Checkpoints
from elfslam.data.tables import check_size, read_named_rows

CHECKPOINTS = "checkpoints.csv"
COLUMNS = ("t_s", "name")
LONGEST_S = 1e6
LONGEST_NAME = 80
MOST = 1_000
"""Tapped by hand, one by one."""


def write_checkpoints(checkpoints: Checkpoints, folder: Path) -> None:
    """The table of a recording, into `folder`."""
    with (folder / CHECKPOINTS).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        for t_s, name in zip(checkpoints.t_s, checkpoints.names, strict=True):
            writer.writerow([f"{t_s:.3f}", name])


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
    check_size(file, t_s[:, None], LONGEST_S, "s")
    order = np.argsort(t_s, kind="stable")
    if (again := np.diff(t_s[order]) <= 0).any():
        twice_s = t_s[order][1:][again][0]
        raise InputError(f"{file}: two checkpoints at {twice_s:.3f} s; give each a time of its own")
    return Checkpoints(t_s[order], tuple(names[k] for k in order))


def _seconds(file: Path, row: int, cell: str) -> float:
    try:
        t_s = float(cell)
    except ValueError:
        t_s = np.nan
    if not np.isfinite(t_s):
        raise InputError(f"{file}: row {row} has time {cell!r:.30}, wanted seconds; repair it")
    return t_s


def _name(file: Path, row: int, cell: str) -> str:
    name = (cell or "").strip()
    if not 0 < len(name) <= LONGEST_NAME:
        raise InputError(
            f"{file}: row {row} has a name of {len(name)} characters, wanted 1 to {LONGEST_NAME}; "
            "give each place a short name"
        )
    return name

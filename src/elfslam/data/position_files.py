"""Positions as text: trajectories as TUM files, fixes as CSV.

TUM: rows `t x y z qx qy qz qw`, no header (Sturm et al. 2012, "A benchmark for the evaluation of
RGB-D SLAM systems"). Fixes: `t_s,x_m,y_m,heading_rad,sigma_m,status`, cells empty without one; in
a building `level` at the end.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.bounds import FARTHEST_M
from elfslam.base.errors import InputError
from elfslam.base.values import Fixes, FixStatus
from elfslam.data.tables import (
    check_size,
    check_times,
    number_or_nan,
    parse_rows,
    read_lines,
    read_named_rows,
)


def write_tum(file: Path, t_s: F64, world_from_body: F64) -> None:
    """Planar poses (n, 3) at times t_s (n); microseconds and nanometres are kept."""
    zero = np.zeros(len(t_s))
    half = world_from_body[:, 2] / 2
    x, y = world_from_body[:, 0], world_from_body[:, 1]
    table = np.column_stack([t_s, x, y, zero, zero, zero, np.sin(half), np.cos(half)])
    np.savetxt(file, table, fmt=["%.6f"] + ["%.9f"] * 7)


def read_tum(file: Path) -> tuple[F64, F64]:
    """Times (n) and planar poses (n, 3); of a rotation in space the turn about z is kept.

    Raises InputError naming file and row.
    """
    lines = read_lines(file)
    table = parse_rows(file, lines, range(8), first_row=1, comma=False)
    check_times(file, table[:, 0], first_row=1)
    check_size(file, table[:, 1:], FARTHEST_M, "m", first_row=1)
    qx, qy, qz, qw = table[:, 4:].T
    heading = np.arctan2(2 * (qw * qz + qx * qy), qw**2 + qx**2 - qy**2 - qz**2)
    return table[:, 0], np.column_stack([table[:, 1:3], heading])


NUMBERS = ("t_s", "x_m", "y_m", "heading_rad", "sigma_m")
HEADER = (*NUMBERS, "status")
LEVEL = "level"
LARGEST = 1e12
"""Beyond any time in seconds and any place in metres."""


def write_fixes(fixes: Fixes, file: Path) -> None:
    """The fixes as CSV; sigma_m is the root of the mean variance of the two axes."""
    variance_m2 = np.trace(fixes.covariance_m2, axis1=1, axis2=2) / 2
    table = [fixes.xy_m, fixes.heading_rad, np.sqrt(variance_m2)]
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER if fixes.level is None else (*HEADER, LEVEL))
        rows = zip(fixes.t_s, np.column_stack(table), fixes.status, _levels(fixes), strict=True)
        for t_s, row, status, level in rows:
            cells = [f"{number:.6f}" if np.isfinite(number) else "" for number in row]
            writer.writerow([f"{t_s:.6f}", *cells, FixStatus(status).name, *level])


def _levels(fixes: Fixes) -> list[list[str]]:
    """The last cells of each row: none where the map is of one floor."""
    if fixes.level is None:
        return [[]] * len(fixes.t_s)
    return [[f"{level:g}" if np.isfinite(level) else ""] for level in fixes.level]


def read_fixes(file: Path) -> Fixes:
    """The fixes in a CSV; covariance is round with sigma_m, score is not stored and so NaN.

    Raises InputError naming file and row.
    """
    rows = read_named_rows(file, HEADER)
    read = [_read_row(file, number, row) for number, row in enumerate(rows, start=2)]
    numbers = np.array([row[0] for row in read]).reshape(-1, len(NUMBERS))
    check_times(file, numbers[:, 0])
    return Fixes(
        t_s=numbers[:, 0],
        xy_m=numbers[:, 1:3],
        heading_rad=numbers[:, 3],
        covariance_m2=numbers[:, 4, None, None] ** 2 * np.eye(2),
        score=np.full(len(read), np.nan),
        status=np.array([row[1] for row in read], dtype=np.int64),
        level=_read_levels(file, rows),
    )


def _read_levels(file: Path, rows: Sequence[Mapping[str, str]]) -> F64 | None:
    if not rows or LEVEL not in rows[0]:
        return None
    levels = np.array([number_or_nan(row[LEVEL] or "nan") for row in rows])
    said = np.array([bool(row[LEVEL].strip()) for row in rows])
    bad = np.flatnonzero(said & ~(np.abs(levels) < LARGEST))
    if len(bad):
        got = rows[bad[0]][LEVEL]
        raise InputError(f"{file}: row {bad[0] + 2} has level {got!r:.30}, wanted a number or none")
    return levels


def _read_row(file: Path, number: int, row: Mapping[str, str]) -> tuple[list[float], int]:
    try:
        status = FixStatus[row["status"]]
        numbers = [float(row[name] or "nan") for name in NUMBERS]
    except (KeyError, ValueError) as cause:
        raise InputError(f"{file}: row {number} is no fix ({cause!s:.60}); repair it") from cause
    x_m, y_m, heading_rad, sigma_m = numbers[1:]
    placed = [math.isfinite(number) for number in (x_m, y_m, sigma_m)]
    wanted = status is FixStatus.OK or any(placed) or math.isfinite(heading_rad)
    lacking = wanted and not all(placed)
    if not math.isfinite(numbers[0]) or lacking or any(abs(number) > LARGEST for number in numbers):
        raise InputError(
            f"{file}: row {number} lacks its time or position, or is beyond belief; repair it"
        )
    return numbers, int(status)

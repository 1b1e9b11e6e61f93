"""Fixes as CSV: `t_s,x_m,y_m,heading_rad,sigma_m,status`, cells empty where there is no fix."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Fixes, FixStatus
from elfslam.data.tables import check_times, read_named_rows

NUMBERS = ("t_s", "x_m", "y_m", "heading_rad", "sigma_m")
HEADER = (*NUMBERS, "status")
LARGEST = 1e12
"""Beyond any time in seconds and any place in metres."""


def write_fixes(fixes: Fixes, file: Path) -> None:
    """The fixes as CSV; sigma_m is the root of the mean variance of the two axes."""
    variance_m2 = np.trace(fixes.covariance_m2, axis1=1, axis2=2) / 2
    table = [fixes.xy_m, fixes.heading_rad, np.sqrt(variance_m2)]
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER)
        for t_s, row, status in zip(fixes.t_s, np.column_stack(table), fixes.status, strict=True):
            cells = [f"{number:.6f}" if np.isfinite(number) else "" for number in row]
            writer.writerow([f"{t_s:.6f}", *cells, FixStatus(status).name])


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
        covariance_m2=_round_covariance(numbers[:, 4]),
        score=np.full(len(read), np.nan),
        status=np.array([row[1] for row in read], dtype=np.int64),
    )


def _round_covariance(sigma_m: F64) -> F64:
    return np.asarray(sigma_m[:, None, None] ** 2 * np.eye(2))


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

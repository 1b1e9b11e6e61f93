"""Trajectories as TUM text files: rows `t x y z qx qy qz qw`, no header.

Format: Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems".
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.data.tables import check_size, check_times, parse_rows, read_lines

LARGEST = 1e8
"""Beyond any place in metres; poses may lie in the frame of a country."""


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
    check_size(file, table[:, 1:], LARGEST, "m", first_row=1)
    qx, qy, qz, qw = table[:, 4:].T
    heading = np.arctan2(2 * (qw * qz + qx * qy), qw**2 + qx**2 - qy**2 - qz**2)
    return table[:, 0], np.column_stack([table[:, 1:3], heading])

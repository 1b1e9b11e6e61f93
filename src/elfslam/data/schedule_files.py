"""When each chirp of a recording was played: chirps.csv."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.data.tables import check_size, read_timed_table, write_timed_table

CHIRPS = "chirps.csv"
LONGEST_S = 1e6


def write_schedule(played_t_s: F64, folder: Path) -> None:
    """The moments (n) at which chirps began to be played, into `folder`."""
    write_timed_table(folder / CHIRPS, [], played_t_s, np.empty((len(played_t_s), 0)))


def read_schedule(folder: Path) -> F64 | None:
    """When the chirps of a recording were played (n); None where nobody says. Raises InputError."""
    file = folder / CHIRPS
    if not file.is_file():
        return None
    t_s, _ = read_timed_table(file, [])
    check_size(file, t_s[:, None], LONGEST_S, "s")
    return t_s

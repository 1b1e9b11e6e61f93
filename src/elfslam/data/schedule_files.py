"""When each chirp of a recording was played, and how loud: chirps.csv."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.data.tables import check_size, read_header, read_timed_table, write_timed_table

CHIRPS = "chirps.csv"
GAIN = "gain_db"
LONGEST_S = 1e6
MOST_DB = 100.0


def write_schedule(played_t_s: F64, gain_db: F64 | None, folder: Path) -> None:
    """The moments (n) at which chirps began to be played, and how loud (n), into `folder`."""
    columns = [] if gain_db is None else [GAIN]
    values = np.empty((len(played_t_s), 0)) if gain_db is None else gain_db[:, None]
    write_timed_table(folder / CHIRPS, columns, played_t_s, values)


def read_schedule(folder: Path) -> tuple[F64 | None, F64 | None]:
    """When the chirps of a recording were played (n), and how loud (n, dB).

    None where nobody says. Raises InputError.
    """
    file = folder / CHIRPS
    if not file.is_file():
        return None, None
    columns = [GAIN] if GAIN in read_header(file) else []
    t_s, values = read_timed_table(file, columns)
    check_size(file, t_s[:, None], LONGEST_S, "s")
    check_size(file, values, MOST_DB, "dB")
    return t_s, values[:, 0] if columns else None

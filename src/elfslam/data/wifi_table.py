"""Wi-Fi scans as rows, one per access point seen in a scan, and as the matrix of a WifiScans."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_text
from elfslam.base.values import WifiScans

MOST_CELLS = 10_000_000
"""Of a table of scans by access points, most of it empty: hours in a mall have a tenth."""
HEADER = ("t_s", "bssid", "rssi_dbm", "frequency_mhz", "age_s")


def scans_from_rows(
    source: Path,
    t_s: Sequence[float],
    bssids: Sequence[str],
    rssi_dbm: Sequence[float],
    age_s: Sequence[float],
) -> WifiScans:
    """Rows of one time make one scan; a bssid seen twice in a scan keeps its last row.

    Raises InputError, starting with `source`, where there are too many of both.
    """
    times, scan = np.unique(np.asarray(t_s, dtype=float), return_inverse=True)
    names = tuple(sorted(set(bssids)))
    if len(times) * len(names) > MOST_CELLS:
        raise InputError(
            f"{source}: {len(times)} scans of {len(names)} access points, wanted at most "
            f"{MOST_CELLS:.1g} pairs; check the columns of time and bssid"
        )
    column = {name: k for k, name in enumerate(names)}
    cells = scan, np.array([column[bssid] for bssid in bssids], dtype=int)
    rssi, age = np.full((2, len(times), len(names)), np.nan)
    rssi[cells], age[cells] = rssi_dbm, age_s
    return WifiScans(times, names, rssi, age)


def write_wifi(wifi: WifiScans, file: Path) -> None:
    """The CSV of a recording; the frequency is left empty, a WifiScans does not hold it.

    Raises InputError for a name with a carriage return, which would not be read back.
    """
    broken = [bssid for bssid in wifi.bssids if "\r" in bssid]
    if broken:
        raise InputError(f"{file}: bssid {broken[0]!r:.60} holds a carriage return; rename it")
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER)
        for k, m in np.argwhere(np.isfinite(wifi.rssi_dbm)):
            age = wifi.age_s[k, m]
            numbers = (f"{wifi.rssi_dbm[k, m]:.9g}", "", f"{age:.9g}" if np.isfinite(age) else "")
            writer.writerow([f"{wifi.t_s[k]:.6f}", wifi.bssids[m], *numbers])


def read_wifi(file: Path) -> WifiScans:
    """The scans of a recording. Raises InputError naming file and row."""
    rows = _read_rows(file)
    header = [name.strip() for name in rows[0]]
    missing = [name for name in HEADER if name not in header and name != "frequency_mhz"]
    if missing:
        raise InputError(f"{file}: column {missing[0]} is missing, got {','.join(header)[:80]}")
    if len(rows) == 1:
        raise InputError(f"{file}: has a header and no rows; delete it if the sensor was off")
    _check_cell_counts(file, rows, len(header))
    columns = {name: [row[k] for row in rows[1:]] for k, name in enumerate(header)}
    t_s = _numbers(file, columns["t_s"])
    _check_order(file, t_s)
    rssi_dbm = _numbers(file, columns["rssi_dbm"])
    age_s = _numbers(file, columns["age_s"], empty=math.nan)
    return scans_from_rows(file, t_s.tolist(), columns["bssid"], rssi_dbm.tolist(), age_s.tolist())


def _read_rows(file: Path) -> list[list[str]]:
    """Cells by row; a name in quotes may hold commas, quotes and line breaks."""
    lines = (f"{line}\n" for line in read_text(file).split("\n"))
    try:
        rows = list(csv.reader(lines, strict=True))
    except csv.Error as cause:
        raise InputError(f"{file}: cannot be read as CSV ({cause}); check the file") from cause
    while rows and len(rows[-1]) < 2 and not "".join(rows[-1]).strip():
        rows.pop()
    if not rows:
        raise InputError(f"{file}: is empty; delete it if there is nothing to say")
    return rows


def _check_cell_counts(file: Path, rows: Iterable[Sequence[str]], wanted: int) -> None:
    for number, row in enumerate(rows, start=1):
        if len(row) != wanted:
            raise InputError(
                f"{file}: row {number} has {len(row)} cells, wanted {wanted}; "
                "the file is cut off or damaged there, remove that row"
            )


def _numbers(file: Path, cells: Sequence[str], *, empty: float | None = None) -> F64:
    return np.array([_number(file, k, cell, empty) for k, cell in enumerate(cells, start=2)])


def _number(file: Path, row: int, cell: str, empty: float | None) -> float:
    if not cell.strip() and empty is not None:
        return empty
    try:
        number = float(cell)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise InputError(
            f"{file}: row {row} has {cell.strip()[:30]!r}, wanted a finite number; "
            "remove or repair that row"
        )
    return number


def _check_order(file: Path, t_s: F64) -> None:
    backward = np.flatnonzero(np.diff(t_s) < 0)
    if len(backward):
        k = int(backward[0]) + 1
        raise InputError(
            f"{file}: time runs backward at row {k + 2} ({t_s[k - 1]:.6f} then {t_s[k]:.6f} s); "
            "sort the rows"
        )

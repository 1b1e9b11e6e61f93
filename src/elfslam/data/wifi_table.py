"""Wi-Fi scans as rows, one per access point seen in a scan, and as the matrix of a WifiScans."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_text
from elfslam.base.values import WifiScans
from elfslam.data.tables import check_size

MOST_CELLS = 10_000_000
"""Of a table of scans by access points, most of it empty: hours in a mall have a tenth."""
LARGEST_DBM = 200.0
HEADER = ("t_s", "bssid", "rssi_dbm", "frequency_mhz", "age_s")


def scans_from_rows(
    source: Path,
    t_s: Sequence[float] | F64,
    bssids: Sequence[str],
    rssi_dbm: Sequence[float] | F64,
    age_s: Sequence[float] | F64,
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
    rows = _rows(file)
    header = [name.strip() for name in next(rows, [])]
    missing = [name for name in HEADER if name not in header and name != "frequency_mhz"]
    if missing:
        raise InputError(f"{file}: column {missing[0]} is missing, got {','.join(header)[:80]}")
    places = [header.index(name) for name in ("t_s", "rssi_dbm", "age_s", "bssid")]
    numbers, bssids = array("d"), list[str]()
    for row, cells in enumerate(rows, start=2):
        if len(cells) != len(header):
            raise InputError(
                f"{file}: row {row} has {len(cells)} cells, wanted {len(header)}; "
                "the file is cut off or damaged there, remove that row"
            )
        t_s, rssi_dbm, age_s, bssid = (cells[k] for k in places)
        numbers.extend(_number(file, row, cell, None) for cell in (t_s, rssi_dbm))
        numbers.append(_number(file, row, age_s, math.nan))
        bssids.append(bssid)
    if not bssids:
        raise InputError(f"{file}: has a header and no rows; delete it if the sensor was off")
    table = np.array(numbers).reshape(-1, 3)
    _check_order(file, table[:, 0])
    check_size(file, table[:, 1:2], LARGEST_DBM, "dBm")
    return scans_from_rows(file, table[:, 0], bssids, table[:, 1], table[:, 2])


def _rows(file: Path) -> Iterator[list[str]]:
    """Cells by row; a name in quotes may hold commas, quotes and line breaks."""
    text = read_text(file).rstrip()
    if not text:
        raise InputError(f"{file}: is empty; delete it if there is nothing to say")
    try:
        yield from csv.reader(_lines(text), strict=True)
    except csv.Error as cause:
        raise InputError(f"{file}: cannot be read as CSV ({cause}); check the file") from cause


def _lines(text: str) -> Iterator[str]:
    """The lines with their ends, one after the other: a list of them is larger than the text."""
    start = 0
    while end := text.find("\n", start) + 1:
        yield text[start:end]
        start = end
    yield text[start:]


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

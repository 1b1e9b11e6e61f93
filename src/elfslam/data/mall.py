"""Walks of the Microsoft Indoor Location Competition 2.0: one text file a walk, no sound.

Lines are tab-separated `unix_ms TYPE values...`, those starting with `#` are the header. In
the full data set two records sometimes run together on one line: what can be read is read, and
such lines are counted, and so are records whose value no sensor can have or whose time is out
of order.
"""

import re
import tempfile
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes
from elfslam.base.values import Magnetometer, Orientation, Recording, Truth, WifiScans
from elfslam.data import log_files, sensor_files
from elfslam.data.tables import in_order, lines_of

RECORD_START = re.compile(r"(?=\d{13}\tTYPE_)")
VECTORS = ("TYPE_ACCELEROMETER", "TYPE_GYROSCOPE", "TYPE_MAGNETIC_FIELD", "TYPE_ROTATION_VECTOR")
WAYPOINT, WIFI = "TYPE_WAYPOINT", "TYPE_WIFI"
FIELDS = {**dict.fromkeys(VECTORS, 6), WAYPOINT: 4, WIFI: 7}
"""Fields of a whole record, time and type included; vectors end in an accuracy."""
LARGEST = dict(zip(VECTORS, (*sensor_files.LARGEST_OF_MOTION, 1.01), strict=True))
LARGEST |= {WAYPOINT: 1e6, WIFI: 200.0}
"""No whole record has a larger value: m/s2, rad/s, microtesla, 1, m, dBm."""
SHORTEST = 3
"""Fields that a record of any other type has at least."""
LONGEST_WALK_MS = 24 * 3600 * 1000
"""A record further from the start has a damaged time."""

Row = tuple[float, ...]
Records = dict[str, list[tuple[int, Row]]]
"""By type: the number of the line, and the row with t_s first."""
WifiRow = tuple[float, str, float, float]
"""t_s, bssid, rssi_dbm, age_s."""


def read_walk(path: Path) -> log_files.Imported:
    """The walk in a .txt file; t = 0 is its startTime, or the first record where that is absent.

    The gyroscope is moved to the accelerometer's times; of records with the same time the first
    counts. Damaged lines are those that were not one whole record in its place. The truth has no
    heading, and is none without waypoints. Raises InputError where the file is no walk.
    """
    text = read_bytes(path).decode("utf-8", errors="replace")
    lines = [line for line in lines_of(text, path) if line.strip()]
    header = [line for line in lines if line.startswith("#")]
    body = [line for line in lines if not line.startswith("#")]
    records, wifi_rows, damaged = _sort_records(body, _start_ms(header, body))
    absent = [kind for kind in VECTORS[:2] if len(records[kind]) < 2]
    if absent:
        raise InputError(f"{path}: has no {absent[0]} records; wanted a walk of the mall data set")
    clock = log_files.clock_of(str(path), np.array([row[0] for _, row in records[VECTORS[0]]]))
    streams = {kind: _stream(rows, clock, damaged) for kind, rows in records.items() if rows}
    motion = (*streams[VECTORS[0]], *streams[VECTORS[1]])
    field, attitude, places = (streams.get(kind) for kind in (*VECTORS[2:], WAYPOINT))
    recording = Recording(
        name=path.stem.strip(".") or "walk",
        device=_device(header),
        imu=sensor_files.imu_on_accelerometer_clock(str(path), *motion),
        orientation=_orientation(*attitude) if attitude else None,
        magnetometer=Magnetometer(*field) if field else None,
        wifi=_wifi(path, wifi_rows, clock, damaged) if wifi_rows else None,
        notes=clock.notes,
    )
    return log_files.Imported(recording, _truth(*places) if places else None, len(damaged))


def is_walk(lines: Sequence[str]) -> bool:
    """Whether one of the lines is a whole record with a value."""
    records, wifi_rows, _ = _sort_records(lines, _start_ms(lines, lines))
    return any(records.values()) or bool(wifi_rows)


def walks_in(path: Path) -> Iterator[Path]:
    """The walk files at `path`: a .txt, a folder (recursively, sorted), a .zip or a .tar.xz.

    A walk from an archive is unpacked for a moment: its path is good until the next is asked
    for. Raises InputError where there is nothing to read or an archive is broken, before the
    first walk: nothing is made of half an archive.
    """
    if path.is_dir():
        files = sorted(path.rglob("*.txt"))
        archives = sorted(path.rglob("*.tar.xz"))
        if not files and not archives:
            raise InputError(f"{path}: holds no walk; wanted .txt files or .tar.xz archives")
        for archive in archives:
            log_files.check_archive(archive)
        yield from files
        for archive in archives:
            yield from _walks_in_archive(archive)
    elif not path.is_file():
        raise InputError(f"{path}: does not exist; wanted a walk, a folder or a .tar.xz archive")
    elif path.name.endswith(".tar.xz") or log_files.starts_with(path, log_files.XZ_START):
        log_files.check_archive(path)
        yield from _walks_in_archive(path)
    else:
        yield from log_files.files_in(path, ".txt")


def _walks_in_archive(path: Path) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        for name, content in log_files.texts_in(path):
            file = Path(folder) / name
            file.write_bytes(content)
            yield file
            file.unlink()


def _start_ms(header: Sequence[str], body: Sequence[str]) -> int:
    found = re.search(r"startTime:(\d{13})", "\n".join(header))
    found = found or re.search(r"(\d{13})\tTYPE_", "\n".join(body[:10]))
    return int(found[1]) if found else 0


def _device(header: Sequence[str]) -> str:
    text = "\n".join(header)
    names = [re.search(rf"{key}:([^\t\n]+)", text) for key in ("Brand", "Model")]
    return " ".join(name[1].strip() for name in names if name) or "unknown"


def _sort_records(
    body: Sequence[str], start_ms: int
) -> tuple[Records, list[tuple[int, WifiRow]], set[int]]:
    """Records by type with t_s first, Wi-Fi rows, and the numbers of damaged lines."""
    records: Records = defaultdict(list)
    wifi_rows: list[tuple[int, WifiRow]] = []
    damaged: set[int] = set()
    for number, line in enumerate(body):
        if line.count("\tTYPE_") != 1:
            damaged.add(number)
        for piece in _pieces(line):
            try:
                _place(number, piece.split("\t"), start_ms, records, wifi_rows)
            except (ValueError, IndexError):
                damaged.add(number)
    return records, wifi_rows, damaged


def _kept(
    numbered: Sequence[tuple[int, Row | WifiRow]], clock: log_files.Clock, damaged: set[int]
) -> tuple[F64, I64]:
    """Times on that clock and indices of the rows in order; other lines are added to `damaged`."""
    t_s = clock.running(np.array([row[0] for _, row in numbered], dtype=np.float64))
    kept = in_order(t_s)
    damaged.update(number for (number, _), good in zip(numbered, kept, strict=True) if not good)
    return t_s[kept], np.flatnonzero(kept)


def _stream(
    numbered: Sequence[tuple[int, Row]], clock: log_files.Clock, damaged: set[int]
) -> log_files.Stream:
    t_s, kept = _kept(numbered, clock, damaged)
    return log_files.rising(t_s, np.array([numbered[k][1][1:] for k in kept]))


def _pieces(line: str) -> list[str]:
    if line.count("\tTYPE_") == 1 and line[:13].isdigit():
        return [line]
    return [piece for piece in RECORD_START.split(line) if piece]


def _place(
    number: int,
    fields: Sequence[str],
    start_ms: int,
    records: Records,
    wifi_rows: list[tuple[int, WifiRow]],
) -> None:
    """Puts one record where it belongs. Raises ValueError or IndexError if it is not whole."""
    kind = fields[1]
    t_s = _since_s(fields[0], start_ms)
    _check(whole=len(fields) >= FIELDS.get(kind, SHORTEST))
    if kind not in FIELDS:
        _check(whole=kind.startswith("TYPE_"))
    elif kind == WIFI:
        # Counted from the end: a network may have tabs in its name.
        bssid, rssi, _, seen_ms = fields[-4:]
        age_s = -_since_s(seen_ms, int(fields[0]))
        wifi_rows.append((number, (t_s, bssid, _number(rssi, kind), age_s)))
    else:
        _check(whole=len(fields) == FIELDS[kind])
        values = fields[2:5] if kind in VECTORS else fields[2:4]
        records[kind].append((number, (t_s, *(_number(value, kind) for value in values))))


def _check(*, whole: bool) -> None:
    if not whole:
        raise ValueError


def _since_s(time_ms: str, start_ms: int) -> float:
    after_ms = int(time_ms) - start_ms
    _check(whole=abs(after_ms) < LONGEST_WALK_MS)
    return after_ms / 1000


def _number(text: str, kind: str) -> float:
    number = float(text)
    _check(whole=abs(number) <= LARGEST[kind])
    return number


def _orientation(t_s: F64, xyz: F64) -> Orientation:
    """Android's rotation vector is the quaternion without its w, which is never negative."""
    w = np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1)))
    quaternion = np.column_stack([xyz, w])
    return Orientation(t_s, quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True))


def _wifi(
    path: Path, numbered: Sequence[tuple[int, WifiRow]], clock: log_files.Clock, damaged: set[int]
) -> WifiScans:
    t_s, kept = _kept(numbered, clock, damaged)
    _, bssids, rssi_dbm, age_s = zip(*(numbered[k][1] for k in kept), strict=True)
    return sensor_files.scans_from_rows(path, t_s, bssids, rssi_dbm, age_s)


def _truth(t_s: F64, xy_m: F64) -> Truth:
    return Truth(t_s, np.column_stack([xy_m, np.full(len(t_s), np.nan)]))

"""Logs of GetSensorData (LOPSI, CSIC), the text files of the IPIN competition.

One record a line, parts by `;`, comments by `%`:

    ACCE | GYRO | MAGN ; app s ; sensor s ; x ; y ; z ; accuracy       m/s2, rad/s, microtesla
    AHRS ; app s ; sensor s ; pitch ; roll ; yaw ; q2 ; q3 ; q4 ; accuracy     degrees; no w
    WIFI ; app s ; sensor s ; name ; address ; [frequency ;] dBm        a name may hold `;`
    POSI ; app s ; counter ; latitude ; longitude ; floor ; building    a landmark that was passed

The app's time is common to all but says when a value was read; the sensor's time says when it
was measured, from an origin of its own. So a sensor's times are moved by the median of the
difference, and the app's are taken where the two do not run alike.
"""

from __future__ import annotations

import math
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes
from elfslam.base.values import Imu, Magnetometer, Orientation, Recording, Truth, WifiScans
from elfslam.data.geographic import HIGHEST_DEG, Origin, from_lon_lat
from elfslam.data.sensor_files import (
    LARGEST_ACCEL_MPS2,
    LARGEST_FIELD_UT,
    LARGEST_TURN_RADPS,
    imu_on_accelerometer_clock,
)
from elfslam.data.streams import attitude_that_agrees, forward, in_mps2
from elfslam.data.tables import in_order, lines_of
from elfslam.data.wifi_table import scans_from_rows

KIND = re.compile(r"[A-Z][A-Z0-9]{3}")
ADDRESS = re.compile(r"[0-9a-fA-F]{2}([:-][0-9a-fA-F]{2}){5}")
LARGEST = {
    "ACCE": LARGEST_ACCEL_MPS2,
    "GYRO": LARGEST_TURN_RADPS,
    "MAGN": LARGEST_FIELD_UT,
    "AHRS": 1.01,
    "WIFI": 200.0,
    "POSI": 360.0,
}
"""No whole record has a larger value: m/s2, rad/s, microtesla, 1, dBm, degrees."""
LONGEST_S = 24 * 3600.0
"""A record at a later time has a damaged one."""
MOST_APART_S = 0.25
"""Between a sensor's time, once moved, and the app's."""

Row = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class GetSensorDataLog:
    """The recording, its landmarks as truth (no rows where none was passed), damaged lines."""

    recording: Recording
    truth: Truth
    damaged_lines: int


@dataclass(frozen=True, eq=False)
class Records:
    """Rows by kind, (app s, sensor s, values...), and the Wi-Fi rows (s, address, dBm)."""

    rows: dict[str, list[Row]]
    wifi: list[tuple[float, str, float]]
    damaged: int


def read_getsensordata(path: Path) -> GetSensorDataLog:
    """The walk in a log; t = 0 is its first acceleration, x east and y north of the first landmark.

    Landmarks on another floor than most are left out: the line knows one plane. Raises
    InputError where the file is no such log or lacks motion.
    """
    lines = _lines(path)
    records = _sort([line for line in lines if not line.startswith("%")])
    missing = [kind for kind in ("ACCE", "GYRO") if len(records.rows[kind]) < 2]
    if missing:
        raise InputError(
            f"{path}: has no {missing[0]} lines; wanted a text log of GetSensorData with "
            "accelerometer and gyroscope"
        )
    start_s = min(row[0] for row in records.rows["ACCE"])
    t_s, accel = _stream(records.rows["ACCE"], start_s)
    imu = imu_on_accelerometer_clock(
        str(path), t_s, in_mps2(accel), *_stream(records.rows["GYRO"], start_s)
    )
    field, attitude = records.rows["MAGN"], records.rows["AHRS"]
    recording = Recording(
        name=path.stem,
        device=_device(lines),
        imu=imu,
        orientation=_orientation(*_stream(attitude, start_s), imu) if attitude else None,
        magnetometer=Magnetometer(*_stream(field, start_s)) if field else None,
        wifi=_wifi(path, records.wifi, start_s),
    )
    return GetSensorDataLog(recording, _truth(records.rows["POSI"], start_s), records.damaged)


def _lines(path: Path) -> list[str]:
    text = read_bytes(path).decode("utf-8", errors="replace")
    return [line.strip() for line in lines_of(text, path) if line.strip()]


def _device(lines: Sequence[str]) -> str:
    text = "\n".join(line for line in lines if line.startswith("%"))
    names = [re.search(rf"% *{key}:[ \t]*([^\n]+)", text) for key in ("Manufacturer", "Model")]
    return " ".join(name[1].strip() for name in names if name) or "unknown"


def _sort(body: Sequence[str]) -> Records:
    """Records by kind, in order of the app's time; what is not whole is counted."""
    rows: dict[str, list[Row]] = defaultdict(list)
    wifi: list[tuple[float, str, float]] = []
    damaged = 0
    for line in body:
        cells = [cell.strip() for cell in line.rstrip(";").split(";")]
        try:
            if cells[0] == "WIFI":
                wifi.append(_seen(cells))
            elif cells[0] in LARGEST:
                rows[cells[0]].append(_row(cells))
            else:
                _check(whole=KIND.fullmatch(cells[0]) is not None)
        except (ValueError, IndexError):
            damaged += 1
    for kind, found in rows.items():
        kept = in_order([row[0] for row in found])
        rows[kind] = [row for row, good in zip(found, kept, strict=True) if good]
        damaged += len(found) - len(rows[kind])
    return Records(rows, wifi, damaged)


def _check(*, whole: bool) -> None:
    if not whole:
        raise ValueError


def _row(cells: Sequence[str]) -> Row:
    """Times and values of a record. Raises ValueError or IndexError if it is not whole."""
    kind = cells[0]
    if kind == "POSI":
        t_s, _, latitude, longitude = (_number(cell) for cell in cells[1:5])
        _check(whole=abs(latitude) <= HIGHEST_DEG and abs(longitude) <= 180)
        floor = tuple(_number(cell) for cell in cells[5:7])
        return _time(t_s), latitude, longitude, *floor, *(0.0,) * (2 - len(floor))
    values = [_number(cell) for cell in (cells[6:9] if kind == "AHRS" else cells[3:6])]
    _check(whole=len(values) == 3 and max(map(abs, values)) <= LARGEST[kind])
    return _time(_number(cells[1])), _number(cells[2]), *values


def _seen(cells: Sequence[str]) -> tuple[float, str, float]:
    """When, which network, how strong: read from the end, where the network's name is not."""
    address = max(k for k in range(3, len(cells)) if ADDRESS.fullmatch(cells[k]))
    level_dbm = _number(cells[-1])
    _check(whole=address < len(cells) - 1 and abs(level_dbm) <= LARGEST["WIFI"])
    return _time(_number(cells[1])), cells[address].lower(), level_dbm


def _number(cell: str) -> float:
    """Some phones write a decimal comma. Raises ValueError."""
    number = float(cell.replace(",", "."))
    _check(whole=math.isfinite(number))
    return number


def _time(t_s: float) -> float:
    _check(whole=0 <= t_s <= LONGEST_S)
    return t_s


def _stream(rows: Sequence[Row], start_s: float) -> tuple[F64, F64]:
    """Times since `start_s` on the app's clock, and values."""
    table = np.array(rows, dtype=np.float64)
    ahead_s = table[:, 0] - table[:, 1]
    moved_s = np.median(ahead_s)
    alike = np.quantile(np.abs(ahead_s - moved_s), 0.95) < MOST_APART_S
    t_s = table[:, 1] + moved_s if alike else table[:, 0]
    return forward(t_s - start_s, table[:, 2:])


def _orientation(t_s: F64, xyz: F64, imu: Imu) -> Orientation | None:
    w = np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1)))
    return attitude_that_agrees(t_s, [np.column_stack([xyz, w])], imu)


def _wifi(path: Path, seen: Sequence[tuple[float, str, float]], start_s: float) -> WifiScans | None:
    if not seen:
        return None
    t_s, addresses, rssi_dbm = zip(*seen, strict=True)
    since_s = [time_s - start_s for time_s in t_s]
    return scans_from_rows(path, since_s, addresses, rssi_dbm, [math.nan] * len(seen))


def _truth(rows: Sequence[Row], start_s: float) -> Truth:
    """Landmarks (t, latitude, longitude, floor, building) of the floor that has most of them."""
    if not rows:
        return Truth(np.empty(0), np.empty((0, 3)))
    floors = Counter(row[3:] for row in rows)
    [(floor, _)] = floors.most_common(1)
    table = np.array([row[:3] for row in rows if row[3:] == floor])
    t_s, degrees = forward(table[:, 0] - start_s, table[:, 1:])
    origin = Origin(*(float(number) for number in degrees[0]))
    xy_m = from_lon_lat(origin, degrees[:, ::-1])
    return Truth(t_s, np.column_stack([xy_m, np.full(len(t_s), np.nan)]))

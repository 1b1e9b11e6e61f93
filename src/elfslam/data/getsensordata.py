"""Logs of GetSensorData (LOPSI, CSIC), the text files of the IPIN competition.

One record a line, parts by `;`, comments by `%`:

    ACCE | GYRO | MAGN ; app s ; sensor s ; x ; y ; z ; accuracy       m/s2, rad/s, microtesla
    AHRS ; app s ; sensor s ; pitch ; roll ; yaw ; q2 ; q3 ; q4 ; accuracy     degrees; no w
    WIFI ; app s ; sensor s ; name ; address ; [frequency ;] dBm        a name may hold `;`
    PRES ; app s ; sensor s ; mbar ; accuracy
    POSI ; app s ; counter ; latitude ; longitude ; floor ; building    a landmark that was passed

The app's time is common to all but says when a value was read; the sensor's time says when it
was measured, from an origin of its own. So a sensor's times are moved by the median of the
difference, and the app's are taken where the two do not run alike.
"""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.text_files import read_bytes
from elfslam.base.values import (
    Barometer,
    Imu,
    Levels,
    Magnetometer,
    Orientation,
    Recording,
    Truth,
    WifiScans,
)
from elfslam.data import log_files, sensor_files
from elfslam.data.geographic import HIGHEST_DEG, Origin, from_lon_lat
from elfslam.data.tables import in_order, lines_of, number_in

PLACES, PRESSURE = "POSI", "PRES"
KIND = re.compile(r"[A-Z][A-Z0-9]{3}")
ADDRESS = re.compile(r"[0-9a-fA-F]{2}([:-][0-9a-fA-F]{2}){5}")
LARGEST = {
    "ACCE": sensor_files.LARGEST_ACCEL_MPS2,
    "GYRO": sensor_files.LARGEST_TURN_RADPS,
    "MAGN": sensor_files.LARGEST_FIELD_UT,
    "AHRS": 1.01,
    "WIFI": 200.0,
    PRESSURE: 1e4,
    PLACES: 360.0,
}
"""No whole record has a larger value: m/s2, rad/s, microtesla, 1, dBm, mbar, degrees."""
LEFT_S = 1e-3
"""After a landmark its floor may be left."""
LONGEST_S = 24 * 3600.0
"""A record at a later time has a damaged one."""
MOST_APART_S = 0.25
"""Between a sensor's time, once moved, and the app's."""

Row = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Records:
    """Rows by kind, (app s, sensor s, values...), and the Wi-Fi rows (s, address, dBm)."""

    rows: dict[str, list[Row]]
    wifi: list[tuple[float, str, float]]
    damaged: int


def read_getsensordata(path: Path) -> log_files.Imported:
    """The walk in a log; t = 0 is its first acceleration, x east and y north of the first landmark.

    Landmarks on another floor than most are left out where no barometer tells floors apart. Raises
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
    tables = {kind: np.array(rows, dtype=np.float64) for kind, rows in records.rows.items() if rows}
    clock = log_files.clock_of(str(path), tables["ACCE"][:, 0])
    kept = {
        kind: log_files.ordered(table[:, 0], table[:, 1:], clock) for kind, table in tables.items()
    }
    start_s = kept["ACCE"][0][0][0]
    streams = {
        kind: _on_sensor_clock(t_s - start_s, values)
        for kind, ((t_s, values), _) in kept.items()
        if kind != PLACES
    }
    accel = log_files.with_gravity([streams["ACCE"]])
    imu = sensor_files.imu_on_accelerometer_clock(str(path), *accel, *streams["GYRO"])
    recording = Recording(
        name=path.stem,
        device=_device(lines),
        imu=imu,
        orientation=_orientation(*streams["AHRS"], imu) if "AHRS" in streams else None,
        magnetometer=Magnetometer(*streams["MAGN"]) if "MAGN" in streams else None,
        barometer=_barometer(streams.get(PRESSURE)),
        wifi=_wifi(path, records.wifi, start_s, clock),
        notes=clock.notes,
    )
    truth = None
    if PLACES in kept:
        t_s, places = kept[PLACES][0]
        # Who knows when floors were changed may be asked for them: all of one building.
        alike = places[:, 3:] if recording.barometer is not None else places[:, 2:]
        truth = _truth(t_s - start_s, places, _most(alike))
    damaged = records.damaged + sum(left_out for _, left_out in kept.values())
    return log_files.Imported(recording, truth, damaged)


def is_getsensordata(lines: Sequence[str]) -> bool:
    """Whether one of the lines is a whole record with a value."""
    records = _sort([line for line in lines if not line.startswith("%")])
    return any(records.rows.values()) or bool(records.wifi)


def _lines(path: Path) -> list[str]:
    text = read_bytes(path).decode("utf-8", errors="replace")
    return [line.strip() for line in lines_of(text, path) if line.strip()]


def _device(lines: Sequence[str]) -> str:
    text = "\n".join(line for line in lines if line.startswith("%"))
    names = [re.search(rf"% *{key}:[ \t]*([^\n]+)", text) for key in ("Manufacturer", "Model")]
    return " ".join(name[1].strip() for name in names if name) or "unknown"


def _sort(body: Sequence[str]) -> Records:
    """Records by kind, as they come; what is not whole is counted."""
    rows: dict[str, list[Row]] = defaultdict(list)
    wifi: list[tuple[float, str, float]] = []
    damaged = 0
    for line in body:
        cells = [cell.strip() for cell in line.strip().rstrip(";").split(";")]
        try:
            if cells[0] == "WIFI":
                wifi.append(_seen(cells))
            elif cells[0] in LARGEST:
                rows[cells[0]].append(_row(cells))
            else:
                _check(whole=KIND.fullmatch(cells[0]) is not None)
        except (ValueError, IndexError):
            damaged += 1
    return Records(rows, wifi, damaged)


def _check(*, whole: bool) -> None:
    if not whole:
        raise ValueError


def _row(cells: Sequence[str]) -> Row:
    """Times and values of a record. Raises ValueError or IndexError if it is not whole."""
    kind = cells[0]
    if kind == PLACES:
        t_s, _, latitude, longitude = (number_in(cell) for cell in cells[1:5])
        _check(whole=abs(latitude) <= HIGHEST_DEG and abs(longitude) <= 180)
        floor = tuple(number_in(cell) for cell in cells[5:7])
        return _time(t_s), latitude, longitude, *floor, *(0.0,) * (2 - len(floor))
    first, count = (6 if kind == "AHRS" else 3), (1 if kind == PRESSURE else 3)
    values = [number_in(cell) for cell in cells[first : first + count]]
    _check(whole=len(values) == count and max(map(abs, values)) <= LARGEST[kind])
    return _time(number_in(cells[1])), number_in(cells[2]), *values


def _seen(cells: Sequence[str]) -> tuple[float, str, float]:
    """When, which network, how strong: read from the end, where the network's name is not."""
    address = max(k for k in range(3, len(cells)) if ADDRESS.fullmatch(cells[k]))
    level_dbm = number_in(cells[-1])
    _check(whole=address < len(cells) - 1 and abs(level_dbm) <= LARGEST["WIFI"])
    return _time(number_in(cells[1])), cells[address].lower(), level_dbm


def _time(t_s: float) -> float:
    _check(whole=0 <= t_s <= LONGEST_S)
    return t_s


def _on_sensor_clock(t_s: F64, values: F64) -> log_files.Stream:
    """Rows (app's time, sensor's time and values) at the sensor's times, moved onto the app's."""
    ahead_s = t_s - values[:, 0]
    moved_s = np.median(ahead_s)
    alike = np.quantile(np.abs(ahead_s - moved_s), 0.95) < MOST_APART_S
    measured_s = values[:, 0] + moved_s if alike else t_s
    kept = in_order(measured_s)
    return log_files.rising(measured_s[kept], values[kept, 1:])


def _barometer(stream: log_files.Stream | None) -> Barometer | None:
    return stream and sensor_files.barometer_from(stream[0], stream[1][:, 0])


def _orientation(t_s: F64, xyz: F64, imu: Imu) -> Orientation | None:
    w = np.sqrt(np.maximum(0, 1 - (xyz**2).sum(axis=1)))
    return log_files.attitude_that_agrees(t_s, [np.column_stack([xyz, w])], imu)


def _wifi(
    path: Path, seen: Sequence[tuple[float, str, float]], start_s: float, clock: log_files.Clock
) -> WifiScans | None:
    if not seen:
        return None
    t_s, addresses, rssi_dbm = zip(*seen, strict=True)
    since_s = clock.running(np.array(t_s)) - start_s
    return sensor_files.scans_from_rows(path, since_s, addresses, rssi_dbm, [math.nan] * len(seen))


def _most(rows: F64) -> Bool:
    """Which rows (n) are those that there are most of."""
    [(row, _)] = Counter(tuple(row) for row in rows).most_common(1)
    return np.asarray((rows == row).all(axis=1))


def _truth(t_s: F64, places: F64, kept: Bool) -> Truth:
    """The landmarks that are `kept`; with levels where those are on several floors."""
    t_s, values = log_files.rising(t_s[kept], places[kept])
    origin = Origin(*(float(number) for number in values[0, :2]))
    xy_m = from_lon_lat(origin, values[:, 1::-1])
    floor = np.rint(values[:, 2])
    levels = _levels(t_s, floor) if (floor != floor[0]).any() else None
    return Truth(t_s, np.column_stack([xy_m, np.full(len(t_s), np.nan)]), levels)


def _levels(t_s: F64, floor: F64) -> Levels:
    """The floors of landmarks; between two on different ones nobody says where it was changed."""
    changes = np.flatnonzero(np.diff(floor))
    when = [(t_s[0], floor[0])]
    for k in changes:
        when += [(t_s[k] + LEFT_S, np.nan), (t_s[k + 1], floor[k + 1])]
    at_s, level = np.array(when).T
    return Levels(at_s, level, (None,) * len(level))

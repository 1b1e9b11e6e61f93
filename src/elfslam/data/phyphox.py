"""Exports of phyphox (RWTH Aachen): a .zip with one CSV per set of buffers, and meta/.

Five ways to write a CSV can be chosen: cells parted by comma, tab or semicolon with a decimal
point, by tab or semicolon with a decimal comma; names stand in quotes, numbers as 1.2E0, and a
shorter buffer is filled up with NaN. Times are seconds of the experiment, which stands still
while it is paused; meta/time.csv says when it was started and paused. Sensors are told apart by
the units in the names of their columns, so that our own experiment, the app's and those of its
users can be read. Sound is a buffer of samples, in a set of its own, its rate in another.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Imu, Magnetometer, Orientation, Recording
from elfslam.data.log_files import is_clutter, log_folder, name_of
from elfslam.data.phyphox_experiment import QUATERNION_COLUMNS, RATE_COLUMN, SOUND_COLUMN
from elfslam.data.sensor_files import (
    LARGEST_ACCEL_MPS2,
    LARGEST_FIELD_UT,
    LARGEST_TURN_RADPS,
    imu_on_accelerometer_clock,
)
from elfslam.data.streams import attitude_that_agrees, forward, in_mps2
from elfslam.data.tables import parse_rows, read_lines, read_text
from elfslam.line.chirp import ACCEPTED_RATES_HZ

SEPARATORS = (",", "\t", ";")
META = "meta"
TIME = re.compile(r".*\(s\)$")
AXIS = re.compile(r"\b([xyz])\b", re.IGNORECASE)
WITHOUT_GRAVITY = re.compile(r"linear|without g|gravity", re.IGNORECASE)
UNITS = {
    "accelerometer": (re.compile(r"m/s(\^2|²|2)"), LARGEST_ACCEL_MPS2),
    "gyroscope": (re.compile(r"rad/s"), LARGEST_TURN_RADPS),
    "magnetometer": (re.compile(r"[µμu]T"), LARGEST_FIELD_UT),
}
"""What tells a sensor's columns, and beyond what it cannot be believed."""
LEAST_SOUND_SHARE = 0.9
"""Of the motion; less means that the buffer of the sound ran over."""
RATE_SLACK = 0.01


@dataclass(frozen=True, eq=False)
class SensorTable:
    """One CSV: the names of its columns, and its numbers (rows, columns) with NaN at the end."""

    file: Path
    names: tuple[str, ...]
    numbers: F64


def read_phyphox(path: Path) -> Recording:
    """The recording in a .zip of CSVs, or in their folder, t = 0 where the experiment was started.

    Raises InputError naming what is missing or bad, for an export as Excel, and for an
    experiment that was paused and went on.
    """
    with log_folder(path) as folder:
        return _read_folder(_folder_of_tables(folder), name_of(path))


def _folder_of_tables(folder: Path) -> Path:
    """Where the CSVs lie: whoever packs an export again packs the folder around them."""
    inside = [each for each in folder.iterdir() if not is_clutter(PurePosixPath(each.name))]
    alone = len(inside) == 1 and inside[0].is_dir() and inside[0].name != META
    return inside[0] if alone else folder


def _read_folder(folder: Path, name: str) -> Recording:
    if (folder / "xl").is_dir():
        raise InputError(f"{folder}: is an Excel file; export as CSV, with any separator")
    _check_one_run(folder / META / "time.csv")
    tables = [_read_table(file) for file in sorted(folder.glob("*.csv"))]
    found = {kind: _sensor(tables, kind) for kind in UNITS}
    accelerometer, gyroscope, magnetometer = found.values()
    if accelerometer is None or gyroscope is None:
        missing = "an accelerometer with g" if accelerometer is None else "a gyroscope"
        raise InputError(
            f"{folder}: has no columns of {missing}; wanted Time (s) and x, y, z in m/s^2 and "
            "rad/s; record with the experiment of `elfslam phyphox`"
        )
    accel = accelerometer[0], in_mps2(accelerometer[1])
    imu = imu_on_accelerometer_clock(str(folder), *accel, *gyroscope)
    return Recording(
        name=name,
        device=_device(folder / META / "device.csv"),
        audio=_sound(folder, tables, imu),
        imu=imu,
        orientation=_orientation(tables, imu),
        magnetometer=magnetometer and Magnetometer(*magnetometer),
    )


def _read_table(file: Path) -> SensorTable:
    head, _, body = read_text(file).rstrip().partition("\n")
    separator = next((each for each in SEPARATORS[1:] if len(_cells(file, head, each)) > 1), ",")
    names = tuple(name.strip() for name in _cells(file, head, separator))
    first_row = body.partition("\n")[0]
    # One column alone needs no separator: then a comma is that of its decimals.
    if (separator != "," or len(names) == 1) and "," in first_row:
        body = body.replace(",", ".")
    return SensorTable(file, names, _numbers(file, body.replace(separator, ","), len(names)))


def _cells(file: Path, line: str, separator: str) -> list[str]:
    try:
        return next(csv.reader([line], delimiter=separator), [])
    except csv.Error as cause:
        raise InputError(f"{file}: cannot be read as CSV ({cause}); export it again") from cause


def _numbers(file: Path, body: str, columns: int) -> F64:
    """Numbers (rows, columns), NaN included."""
    if not body:
        return np.empty((0, columns))
    try:
        numbers = np.loadtxt(
            io.StringIO(body), delimiter=",", comments=None, ndmin=2, usecols=range(columns)
        )
    except (ValueError, IndexError):
        numbers = np.empty((0, columns))
    if len(numbers) != body.count("\n") + 1 or np.isinf(numbers).any():
        # It names the row; NaN is none of its business here.
        lines = [_without_nan(line) for line in body.splitlines()]
        parse_rows(file, lines, range(columns), first_row=2)
        raise InputError(f"{file}: cannot be read as numbers; export it again")
    return np.asarray(numbers, dtype=np.float64)


def _without_nan(line: str) -> str:
    return ",".join("0" if cell.strip().lower() == "nan" else cell for cell in line.split(","))


def _columns(table: SensorTable, wanted: Sequence[int]) -> F64:
    """Some columns, up to where all of them end. Raises InputError for NaN before that."""
    values = table.numbers[:, list(wanted)]
    whole = np.asarray(np.isfinite(values).all(axis=1))
    count = int(whole.sum())
    if not whole[:count].all():
        row = int(np.argmin(whole)) + 2
        raise InputError(
            f"{table.file}: row {row} has NaN in the middle of a column; export it again"
        )
    return np.asarray(values[:count])


def _sensor(tables: Sequence[SensorTable], kind: str) -> tuple[F64, F64] | None:
    """Times and values of a sensor, from the first set that has it."""
    unit, largest = UNITS[kind]
    for table in tables:
        columns = _axes(table, unit)
        if columns is None:
            continue
        values = _columns(table, columns)
        if len(values) < 2:
            continue
        worst = float(np.abs(values[:, 1:]).max())
        if worst > largest:
            raise InputError(
                f"{table.file}: has {worst:g} in {table.names[columns[1]]}, wanted at most "
                f"{largest:g}; the file is damaged, export it again"
            )
        return forward(values[:, 0], values[:, 1:])
    return None


def _axes(table: SensorTable, unit: re.Pattern[str]) -> list[int] | None:
    """Which columns hold the time and x, y, z in that unit; None where not all are there."""
    if WITHOUT_GRAVITY.search(table.file.stem):
        return None
    found: dict[str, int] = {}
    for k, name in enumerate(table.names):
        axis = AXIS.search(name)
        if TIME.match(name):
            found.setdefault("t", k)
        elif axis and unit.search(name) and not WITHOUT_GRAVITY.search(name):
            found.setdefault(axis[1].lower(), k)
    return [found[key] for key in "txyz"] if len(found) == 4 else None


def _named(tables: Sequence[SensorTable], names: Sequence[str]) -> F64 | None:
    """The columns of these names, from the first set that has all of them."""
    for table in tables:
        if set(names) <= set(table.names):
            return _columns(table, [table.names.index(name) for name in names])
    return None


def _sound(folder: Path, tables: Sequence[SensorTable], imu: Imu) -> Audio | None:
    """The buffer of our experiment. Raises InputError where it ran over, or for another rate."""
    samples, rates = _named(tables, [SOUND_COLUMN]), _named(tables, [RATE_COLUMN])
    if samples is None or not len(samples):
        return None
    said_hz = float(rates[-1, 0]) if rates is not None and len(rates) else 0.0
    nearest = min(ACCEPTED_RATES_HZ, key=lambda rate_hz: abs(rate_hz - said_hz))
    if abs(said_hz - nearest) > RATE_SLACK * nearest:
        raise InputError(
            f"{folder}: the sound was recorded at {said_hz:g} samples/s, wanted "
            f"{' or '.join(map(str, ACCEPTED_RATES_HZ))}; this phone cannot be used"
        )
    duration_s, moved_s = len(samples) / nearest, float(imu.t_s[-1])
    if duration_s < LEAST_SOUND_SHARE * moved_s:
        raise InputError(
            f"{folder}: {duration_s:.0f} s of sound for {moved_s:.0f} s of motion; its buffer ran "
            "over: walk shorter, or make the experiment with more --minutes"
        )
    return Audio(np.clip(samples.T, -1, 1), nearest)


def _orientation(tables: Sequence[SensorTable], imu: Imu) -> Orientation | None:
    attitude = _named(tables, QUATERNION_COLUMNS)
    if attitude is None or not len(attitude):
        return None
    t_s, quaternion = forward(attitude[:, 0], attitude[:, 1:])
    return attitude_that_agrees(t_s, [quaternion], imu)


def _meta(file: Path) -> list[list[str]]:
    """Rows of a file of meta/, its header left out; none where it is not there."""
    lines = read_lines(file) if file.is_file() else [""]
    separator = next((each for each in SEPARATORS if each in lines[0]), ",")
    return [_cells(file, line, separator) for line in lines[1:]]


def _device(file: Path) -> str:
    facts = {row[0]: row[1] for row in _meta(file) if len(row) > 1}
    names = [facts.get(key, "") for key in ("deviceBrand", "deviceModel")]
    return " ".join(name for name in names if name) or "unknown"


def _check_one_run(file: Path) -> None:
    """Refuse an experiment that went on after a pause: its clock stood still."""
    events = [row[0].strip().upper() for row in _meta(file) if row]
    if events.count("START") > 1:
        raise InputError(
            f"{file}: the experiment was started {events.count('START')} times, wanted one run "
            "without a pause; clear the data before each walk"
        )

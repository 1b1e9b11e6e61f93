"""Logs of the Sensor Logger app (Kelvin Choi): a .zip with one CSV per sensor.

Conventions, from the app's own pages on units, coordinates and platforms: `seconds_elapsed`
counts from the start and may begin below zero, accelerations are in m/s2 (in g where
uncalibrated on iOS), turn rates in rad/s, the field in microtesla. On iOS acceleration and
gravity have the opposite sign unless "Standardise Units & Frames" was on, which Metadata.csv
says in `standardisation`. Only Android writes an acceleration with gravity.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Audio, Imu, Magnetometer, Orientation, Recording, WifiScans
from elfslam.data.audio_files import read_audio
from elfslam.data.log_files import log_folder, name_of
from elfslam.data.sensor_files import (
    AXES,
    LARGEST_ACCEL_MPS2,
    LARGEST_FIELD_UT,
    LARGEST_TURN_RADPS,
    QUATERNION,
    imu_on_accelerometer_clock,
)
from elfslam.data.streams import attitude_that_agrees, find_file, forward, in_mps2
from elfslam.data.tables import check_size, read_named_rows, read_table
from elfslam.data.wifi_table import scans_from_rows

LOWEST_RATE_HZ = 44_100
"""The app's lossy sound has less than this, and nothing in the chirp band."""
SOUND_FILES = ("Microphone.wav", "Microphone.flac")
LARGEST = {
    "Gyroscope": (LARGEST_TURN_RADPS, "rad/s"),
    "Magnetometer": (LARGEST_FIELD_UT, "microtesla"),
    "Orientation": (1.01, ""),
}
"""What a sensor can read, with its unit; the rest are accelerations."""
Table = tuple[F64, F64]


def read_sensorlogger(path: Path) -> Recording:
    """The recording in a .zip of the app, or in its folder, t = 0 where the app began.

    Sound is kept only where lossless at 44.1 kHz or more (the app itself plays no chirps), the
    attitude only where it agrees with gravity. Raises InputError naming what is missing or bad.
    """
    with log_folder(path) as folder:
        return _read_folder(folder, name_of(path))


def _read_folder(folder: Path, name: str) -> Recording:
    facts = _metadata(folder)
    acceleration, gyroscope = _acceleration(folder, facts), _sensor(folder, "Gyroscope")
    if acceleration is None or gyroscope is None:
        wanted = "TotalAcceleration.csv (or Accelerometer.csv and Gravity.csv) and Gyroscope.csv"
        raise InputError(f"{folder}: motion sensors are missing; wanted {wanted}")
    imu = imu_on_accelerometer_clock(str(folder), *acceleration, *gyroscope)
    magnetometer = _sensor(folder, "Magnetometer")
    return Recording(
        name=name,
        device=facts.get("device name") or "unknown",
        audio=_sound(folder),
        imu=imu,
        orientation=_orientation(folder, imu),
        magnetometer=magnetometer and Magnetometer(*magnetometer),
        wifi=_wifi(folder),
    )


def _metadata(folder: Path) -> dict[str, str]:
    file = find_file(folder, "Metadata.csv")
    return next(iter(read_named_rows(file, ())), {}) if file else {}


def _sensor(folder: Path, name: str, columns: tuple[str, ...] = AXES) -> Table | None:
    """Times and values of a sensor; rows that repeat a time or are out of order are left out."""
    file = find_file(folder, f"{name}.csv")
    if file is None:
        return None
    table = read_table(file, ["seconds_elapsed", *columns])
    check_size(file, table[:, 1:], *LARGEST.get(name, (LARGEST_ACCEL_MPS2, "m/s2")))
    return forward(table[:, 0], table[:, 1:])


def _acceleration(folder: Path, facts: dict[str, str]) -> Table | None:
    total = (
        _sensor(folder, "TotalAcceleration")
        or _summed_acceleration(folder)
        or _sensor(folder, "AccelerometerUncalibrated")
    )
    if total is None:
        return None
    t_s, values = total[0], in_mps2(total[1])
    return t_s, -values if _is_flipped(values, facts) else values


def _summed_acceleration(folder: Path) -> Table | None:
    moving, gravity = _sensor(folder, "Accelerometer"), _sensor(folder, "Gravity")
    if moving is None or gravity is None:
        return None
    t_s, values = moving
    return t_s, values + np.column_stack(
        [np.interp(t_s, gravity[0], axis) for axis in gravity[1].T]
    )


def _is_flipped(values: F64, facts: dict[str, str]) -> bool:
    """iOS without standardisation; old logs do not say, there a phone is held face up."""
    if facts.get("platform", "").lower() != "ios":
        return False
    standardised = facts.get("standardisation", "").lower()
    if standardised in ("true", "false"):
        return standardised == "false"
    return bool(values[:, 2].mean() < 0)


def _orientation(folder: Path, imu: Imu) -> Orientation | None:
    """Platforms and versions differ in which way the quaternion turns: gravity decides."""
    attitude = _sensor(folder, "Orientation", QUATERNION)
    return attitude and attitude_that_agrees(attitude[0], [attitude[1]], imu)


def _wifi(folder: Path) -> WifiScans | None:
    """Rows `seconds_elapsed, bssid, level`; a network's name may hold anything, commas too."""
    file = find_file(folder, "WiFi.csv")
    if file is None:
        return None
    seen: list[tuple[float, str, float]] = []
    for number, row in enumerate(read_named_rows(file, ()), start=2):
        cells = _seen(row)
        if cells is None:
            raise InputError(
                f"{file}: row {number} lacks a number in seconds_elapsed or level, or a bssid; "
                "repair that row or delete the file"
            )
        seen.append(cells)
    if not seen:
        return None
    t_s, bssids, rssi_dbm = zip(*seen, strict=True)
    return scans_from_rows(file, t_s, bssids, rssi_dbm, [math.nan] * len(seen))


def _seen(row: Mapping[str, str]) -> tuple[float, str, float] | None:
    """When, which network and how strong; None where a cell is missing or no number."""
    bssid = row.get("bssid")
    try:
        t_s, level_dbm = float(row["seconds_elapsed"]), float(row["level"])
    except (ValueError, KeyError):
        return None
    return (t_s, bssid, level_dbm) if bssid and math.isfinite(t_s + level_dbm) else None


def _sound(folder: Path) -> Audio | None:
    file = next(filter(None, (find_file(folder, name) for name in SOUND_FILES)), None)
    audio = read_audio(file) if file else None
    return audio if audio and audio.rate_hz >= LOWEST_RATE_HZ else None

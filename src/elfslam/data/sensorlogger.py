"""Logs of the Sensor Logger app (Kelvin Choi): a .zip with one CSV per sensor.

Conventions, from the app's own pages on units, coordinates and platforms: `seconds_elapsed`
counts from the start, accelerations are in m/s2 (in g where uncalibrated on iOS), turn rates in
rad/s, the field in microtesla. On iOS acceleration and gravity have the opposite sign unless
"Standardise Units & Frames" was on, which Metadata.csv says in `standardisation`.
"""

from __future__ import annotations

import csv
import tempfile
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.geometry import rotation_from_quaternion
from elfslam.base.values import Audio, Imu, Magnetometer, Orientation, Recording
from elfslam.data.audio_files import read_audio
from elfslam.data.folders import unpack_zip
from elfslam.data.sensor_files import (
    AXES,
    LARGEST_ACCEL_MPS2,
    LARGEST_FIELD_UT,
    LARGEST_TURN_RADPS,
    QUATERNION,
    imu_on_accelerometer_clock,
)
from elfslam.data.tables import check_size, in_order, read_lines, read_table

STANDARD_GRAVITY_MPS2 = 9.80665
LARGEST_MEAN_IN_G = 3.0
"""A mean acceleration below this is in g, one above it in m/s2."""
LOWEST_RATE_HZ = 44_100
"""The app's lossy sound has less than this, and nothing in the chirp band."""
SOUND_FILES = ("Microphone.wav", "Microphone.flac")
LARGEST = {
    "Gyroscope": (LARGEST_TURN_RADPS, "rad/s"),
    "Magnetometer": (LARGEST_FIELD_UT, "microtesla"),
    "Orientation": (1.01, ""),
}
"""What a sensor can read, with its unit; the rest are accelerations."""
LARGEST_TILT_RAD = 0.5
"""An attitude whose vertical is further from the measured one is not understood."""

Table = tuple[F64, F64]


def read_sensorlogger(path: Path) -> Recording:
    """The recording in a .zip of the app, t = 0 where the app began.

    Sound is kept only where lossless at 44.1 kHz or more (the app itself plays no chirps), the
    attitude only where it agrees with gravity. Raises InputError naming what is missing or bad.
    """
    with tempfile.TemporaryDirectory() as name:
        unpack_zip(path, Path(name))
        try:
            return _read_folder(Path(name), path.stem)
        except InputError as cause:
            raise InputError(str(cause).replace(name, str(path))) from None


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
    )


def _find(folder: Path, file_name: str) -> Path | None:
    return next(iter(sorted(folder.rglob(file_name))), None)


def _metadata(folder: Path) -> dict[str, str]:
    file = _find(folder, "Metadata.csv")
    row = next(csv.DictReader(read_lines(file)), None) if file else None
    return {key: str(value or "") for key, value in (row or {}).items()}


def _sensor(folder: Path, name: str, columns: tuple[str, ...] = AXES) -> Table | None:
    """Times and values of a sensor; rows that repeat a time or are out of order are left out."""
    file = _find(folder, f"{name}.csv")
    if file is None:
        return None
    table = read_table(file, ["seconds_elapsed", *columns])
    check_size(file, table[:, 1:], *LARGEST.get(name, (LARGEST_ACCEL_MPS2, "m/s2")))
    table = table[in_order(table[:, 0])]
    kept = np.diff(table[:, 0], prepend=-np.inf) > 0
    return table[kept, 0], table[kept, 1:]


def _acceleration(folder: Path, facts: dict[str, str]) -> Table | None:
    total = _sensor(folder, "TotalAcceleration") or _summed_acceleration(folder)
    if total is None:
        return None
    t_s, values = total
    if np.linalg.norm(values, axis=1).mean() < LARGEST_MEAN_IN_G:
        values = values * STANDARD_GRAVITY_MPS2
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
    if attitude is None:
        return None
    t_s, quaternion = attitude
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    quaternion = quaternion / np.where(length > 0, length, np.nan)
    up = np.column_stack([np.interp(t_s, imu.t_s, axis) for axis in imu.accel_mps2.T])
    candidates = (quaternion, quaternion * [-1, -1, -1, 1])
    tilts = [_tilt_rad(candidate, up) for candidate in candidates]
    if not min(tilts) < LARGEST_TILT_RAD:
        return None
    return Orientation(t_s, candidates[int(np.argmin(tilts))])


def _tilt_rad(world_from_phone: F64, up: F64) -> float:
    """Angle between the vertical and the mean measured acceleration turned into the world."""
    turned = np.einsum("nij,nj->ni", rotation_from_quaternion(world_from_phone), up).mean(axis=0)
    return float(np.arccos(np.clip(turned[2] / np.linalg.norm(turned), -1, 1)))


def _sound(folder: Path) -> Audio | None:
    file = next(filter(None, (_find(folder, name) for name in SOUND_FILES)), None)
    audio = read_audio(file) if file else None
    return audio if audio and audio.rate_hz >= LOWEST_RATE_HZ else None

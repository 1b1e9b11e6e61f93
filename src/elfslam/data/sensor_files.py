"""Sensors of a recording on disk, one file each."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.geometry import between
from elfslam.base.values import Emr, Imu, Magnetometer, Odometry, Orientation, Recording
from elfslam.data.tables import read_header, read_table, read_timed_table, write_timed_table
from elfslam.data.tum import read_tum, write_tum
from elfslam.data.wifi_table import write_wifi

AXES = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
SIGMAS = ("forward_m", "lateral_m", "heading_rad")
ODOMETRY_SIGMA_PER_METRE = 0.02
ODOMETRY_SIGMA_FLOOR = (0.005, 0.005, 0.005)
"""Assumed of odometry that comes without its own sigmas: 2 % of the distance, and metres and
radians per move below which no phone's odometry is trusted."""


def write_sensors(recording: Recording, folder: Path) -> None:
    """One file per sensor that the recording has, sound left out."""
    for name, columns, t_s, values in _tables(recording):
        write_timed_table(folder / name, columns, t_s, values)
    if recording.wifi is not None:
        write_wifi(recording.wifi, folder / "wifi.csv")
    odometry = recording.odometry
    if odometry is not None:
        write_tum(folder / "odometry.tum", odometry.t_s, odometry.world_from_body)
        sigma_file, t_s = folder / "odometry_sigma.csv", odometry.t_s[1:]
        write_timed_table(sigma_file, SIGMAS, t_s, odometry.step_sigma)


def _tables(recording: Recording) -> list[tuple[str, tuple[str, ...], F64, F64]]:
    tables: list[tuple[str, tuple[str, ...], F64, F64]] = []
    if (imu := recording.imu) is not None:
        tables.append(("accelerometer.csv", AXES, imu.t_s, imu.accel_mps2))
        tables.append(("gyroscope.csv", AXES, imu.t_s, imu.gyro_radps))
    if (magnetometer := recording.magnetometer) is not None:
        tables.append(("magnetometer.csv", AXES, magnetometer.t_s, magnetometer.field_ut))
    if (attitude := recording.orientation) is not None:
        tables.append(("orientation.csv", QUATERNION, attitude.t_s, attitude.world_from_phone))
    if (emr := recording.emr) is not None:
        harmonics = tuple(f"h{k + 1}" for k in range(emr.amplitude.shape[1]))
        tables.append(("emr.csv", harmonics, emr.t_s, emr.amplitude))
    return tables


def _read_optional(file: Path, columns: tuple[str, ...]) -> tuple[F64, F64] | None:
    return read_timed_table(file, columns) if file.is_file() else None


def read_magnetometer(file: Path) -> Magnetometer | None:
    """The field; None without the file. Raises InputError naming file and row."""
    table = _read_optional(file, AXES)
    return table and Magnetometer(*table)


def read_orientation(file: Path) -> Orientation | None:
    """The attitude; None without the file. Raises InputError naming file and row."""
    table = _read_optional(file, QUATERNION)
    if table is None:
        return None
    t_s, quaternion = table
    length = np.linalg.norm(quaternion, axis=1)
    bad = np.flatnonzero(abs(length - 1) > 0.01)
    if len(bad):
        raise InputError(
            f"{file}: row {bad[0] + 2} has a quaternion of length {length[bad[0]]:.3f}, wanted 1; "
            "check the columns"
        )
    return Orientation(t_s, quaternion / length[:, None])


def read_imu(folder: Path) -> Imu | None:
    """Accelerometer and gyroscope; None without both. Raises InputError naming file and row."""
    accelerometer = _read_optional(folder / "accelerometer.csv", AXES)
    gyroscope = _read_optional(folder / "gyroscope.csv", AXES)
    if accelerometer is None and gyroscope is None:
        return None
    if accelerometer is None or gyroscope is None:
        absent = "accelerometer.csv" if accelerometer is None else "gyroscope.csv"
        raise InputError(f"{folder}: {absent} is missing beside its twin; record both or neither")
    return imu_on_accelerometer_clock(str(folder), *accelerometer, *gyroscope)


def imu_on_accelerometer_clock(
    source: str, accel_t_s: F64, accel_mps2: F64, gyro_t_s: F64, gyro_radps: F64
) -> Imu:
    """The gyroscope interpolated to the accelerometer's times, where both were running.

    Raises InputError, starting with `source`, where they overlap in fewer than two samples.
    """
    inside = (accel_t_s >= gyro_t_s[0]) & (accel_t_s <= gyro_t_s[-1])
    if inside.sum() < 2:
        raise InputError(f"{source}: accelerometer and gyroscope do not overlap in time")
    t_s = accel_t_s[inside]
    turned = [np.interp(t_s, gyro_t_s, axis) for axis in gyro_radps.T]
    return Imu(t_s, accel_mps2[inside], np.column_stack(turned))


def read_emr(file: Path) -> Emr | None:
    """Mains harmonics; None without the file. Raises InputError naming file and row."""
    if not file.is_file():
        return None
    harmonics = [name for name in read_header(file) if name != "t_s"]
    return Emr(*read_timed_table(file, harmonics))


def read_odometry(folder: Path) -> Odometry | None:
    """The device's own odometry; None without. Raises InputError naming file and row."""
    file, sigma_file = folder / "odometry.tum", folder / "odometry_sigma.csv"
    if not file.is_file():
        return None
    t_s, poses = read_tum(file)
    if not sigma_file.is_file():
        return Odometry(t_s, poses, _assumed_sigma(poses))
    sigma = read_table(sigma_file, SIGMAS) if len(t_s) > 1 else np.empty((0, 3))
    if len(sigma) != len(t_s) - 1:
        raise InputError(f"{sigma_file}: {len(sigma)} rows for {len(t_s)} poses; wanted one less")
    return Odometry(t_s, poses, sigma)


def _assumed_sigma(poses: F64) -> F64:
    moves = between(poses[:-1], poses[1:])
    distance_m = np.linalg.norm(moves[:, :2], axis=1)
    grown = np.column_stack([distance_m * ODOMETRY_SIGMA_PER_METRE] * 2 + [0 * distance_m])
    return np.asarray(np.maximum(grown, ODOMETRY_SIGMA_FLOOR))

"""What the logs of other programs have in common: rows out of order, g, unknown quaternions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.geometry import rotation_from_quaternion
from elfslam.base.values import Imu, Orientation
from elfslam.data.tables import in_order

STANDARD_GRAVITY_MPS2 = 9.80665
LARGEST_MEAN_IN_G = 3.0
"""A mean acceleration below this is in g, one above it in m/s2."""
LARGEST_TILT_RAD = 0.5
"""An attitude whose vertical is further from the measured one is not understood."""
CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])


def find_file(folder: Path, file_name: str) -> Path | None:
    """The file of that name anywhere in a folder, the first by path; None where there is none."""
    return next(iter(sorted(folder.rglob(file_name))), None)


def forward(t_s: F64, values: F64) -> tuple[F64, F64]:
    """The rows whose time goes forward; rows that repeat a time or leap are left out."""
    good = in_order(t_s)
    t_s, values = t_s[good], values[good]
    kept = np.diff(t_s, prepend=-np.inf) > 0
    return t_s[kept], values[kept]


def in_mps2(values: F64) -> F64:
    """Accelerations (n, 3) with gravity in m/s2, whether they come in that or in g."""
    in_g = np.linalg.norm(values, axis=1).mean() < LARGEST_MEAN_IN_G
    return values * STANDARD_GRAVITY_MPS2 if in_g else values


def attitude_that_agrees(t_s: F64, candidates: Sequence[F64], imu: Imu) -> Orientation | None:
    """The reading of a quaternion, x y z w, whose vertical is that of the accelerometer.

    Programs differ in the order of its parts and in which way it turns: every candidate (n, 4)
    is tried both ways. None where none agrees.
    """
    up = np.column_stack([np.interp(t_s, imu.t_s, axis) for axis in imu.accel_mps2.T])
    turned = [_unit(each * way) for each in candidates for way in (np.ones(4), CONJUGATE)]
    tilts = [_tilt_rad(each, up) for each in turned]
    if not min(tilts) < LARGEST_TILT_RAD:
        return None
    return Orientation(t_s, turned[int(np.argmin(tilts))])


def _unit(quaternion: F64) -> F64:
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.asarray(quaternion / np.where(length > 0, length, np.nan))


def _tilt_rad(world_from_phone: F64, up: F64) -> float:
    """Angle between the vertical and the mean measured acceleration turned into the world."""
    if not np.isfinite(world_from_phone).all():
        return np.inf
    turned = np.einsum("nij,nj->ni", rotation_from_quaternion(world_from_phone), up).mean(axis=0)
    length = np.linalg.norm(turned)
    return float(np.arccos(np.clip(turned[2] / length, -1, 1))) if length > 0 else np.inf

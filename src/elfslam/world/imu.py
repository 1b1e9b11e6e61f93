"""What accelerometer and gyroscope of a named grade read along a walk."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64
from elfslam.base.values import Imu
from elfslam.world.device import ImuGrade
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion

GRAVITY_MPS2 = 9.80665
GYRO_SCALE_ERROR = 0.01
"""One standard deviation; the BMI160 data sheet bounds the sensitivity error by 3 %."""


def attitude(motion: Motion) -> Rotation:
    """world_from_phone: y (up the screen) ahead and tilted up by the pitch, z out of the screen."""
    angles = np.column_stack([motion.yaw_rad - np.pi / 2, motion.pitch_rad, motion.roll_rad])
    return Rotation.from_euler("ZXY", angles)


def read_imu(
    motion: Motion, grade: ImuGrade, generator: np.random.Generator, decimals: int | None = None
) -> Imu:
    """Samples with constant biases, white noise and a gyroscope scale error.

    `decimals` rounds both to so many places (browsers give 0.1 m/s2 and 0.1 deg/s).
    """
    dt_s = 1 / KINEMATICS_RATE_HZ
    turn = attitude(motion)
    acceleration = np.gradient(np.gradient(motion.position_m, dt_s, axis=0), dt_s, axis=0)
    force = turn.inv().apply(acceleration + np.array([0.0, 0.0, GRAVITY_MPS2]))
    rate = (turn[:-1].inv() * turn[1:]).as_rotvec() / dt_s
    step = round(KINEMATICS_RATE_HZ / grade.rate_hz)
    t_s, accel = motion.t_s[:-1:step], force[:-1:step]
    gyro = rate[::step] * (1 + GYRO_SCALE_ERROR * generator.standard_normal())
    accel = accel + _errors(
        generator, accel.shape, grade.accel_bias_mps2, grade.accel_noise_mps2_rthz, grade
    )
    gyro = gyro + _errors(
        generator, gyro.shape, grade.gyro_bias_radps, grade.gyro_noise_radps_rthz, grade
    )
    if decimals is not None:
        accel, gyro = np.round(accel, decimals), np.deg2rad(np.round(np.rad2deg(gyro), decimals))
    return Imu(t_s, accel, gyro)


def _errors(
    generator: np.random.Generator,
    shape: tuple[int, ...],
    bias: float,
    density: float,
    grade: ImuGrade,
) -> F64:
    """A constant bias per axis and white noise of the given density."""
    noise = density * np.sqrt(grade.rate_hz / 2) * generator.standard_normal(shape)
    return np.asarray(bias * generator.standard_normal(shape[1]) + noise)

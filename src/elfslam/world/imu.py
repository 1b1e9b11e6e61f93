"""What accelerometer and gyroscope of a named grade read along a walk."""

import numpy as np
from scipy import signal
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64
from elfslam.base.values import Imu
from elfslam.world.device import ImuGrade
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion

GRAVITY_MPS2 = 9.80665
GYRO_SCALE_ERROR = 0.01
"""One standard deviation; the BMI160 data sheet bounds the sensitivity error by 3 %."""
BIAS_CORRELATION_S = 100.0
ALLAN_PEAK = 0.618
"""Allan deviation of a first-order Gauss-Markov process at its highest, over its standard
deviation; it lies at 1.89 correlation times."""


def attitude(motion: Motion) -> Rotation:
    """world_from_phone: y (up the screen) ahead and tilted up by the pitch, z out of the screen."""
    angles = np.column_stack([motion.yaw_rad - np.pi / 2, motion.pitch_rad, motion.roll_rad])
    return Rotation.from_euler("ZXY", angles)


def read_imu(motion: Motion, grade: ImuGrade, generator: np.random.Generator) -> Imu:
    """Samples with constant biases, white noise, a gyroscope scale error and a wandering bias."""
    dt_s = 1 / KINEMATICS_RATE_HZ
    turn = attitude(motion)
    acceleration = np.gradient(np.gradient(motion.position_m, dt_s, axis=0), dt_s, axis=0)
    force = turn.inv().apply(acceleration + np.array([0.0, 0.0, GRAVITY_MPS2]))
    rate = (turn[:-1].inv() * turn[1:]).as_rotvec() / dt_s
    t_s = sample_times(motion, grade.rate_hz)
    accel = _at(motion, force[:-1], t_s)
    gyro = _at(motion, rate, t_s) * (1 + GYRO_SCALE_ERROR * generator.standard_normal())
    accel = accel + _errors(
        generator, accel.shape, grade.accel_bias_mps2, grade.accel_noise_mps2_rthz, grade
    )
    gyro = gyro + _errors(
        generator, gyro.shape, grade.gyro_bias_radps, grade.gyro_noise_radps_rthz, grade
    )
    if grade.gyro_bias_instability_radps > 0:
        sigma = grade.gyro_bias_instability_radps / ALLAN_PEAK
        gyro = gyro + sigma * gauss_markov(generator, gyro.shape, BIAS_CORRELATION_S, grade.rate_hz)
    if (places := grade.decimals) is not None:
        accel, gyro = np.round(accel, places), np.deg2rad(np.round(np.rad2deg(gyro), places))
    return Imu(t_s, accel, gyro)


def sample_times(motion: Motion, rate_hz: float) -> F64:
    """Times of a sensor of any rate up to that of the kinematics, from the start of the walk."""
    step = KINEMATICS_RATE_HZ / rate_hz
    if step == round(step):
        return motion.t_s[: -1 : round(step)]
    return np.arange(int((len(motion.t_s) - 2) / step) + 1) / rate_hz


def _at(motion: Motion, rows: F64, t_s: F64) -> F64:
    """Rows (n-1, 3) on the clock of the motion, read at other times."""
    before = np.minimum((t_s * KINEMATICS_RATE_HZ + 1e-6).astype(int), len(rows) - 1)
    share = (t_s * KINEMATICS_RATE_HZ - before)[:, None]
    after = np.minimum(before + 1, len(rows) - 1)
    mixed = (1 - share) * rows[before] + share * rows[after]
    return np.asarray(np.where(share < 1e-6, rows[before], mixed))


def gauss_markov(
    generator: np.random.Generator, shape: tuple[int, ...], correlation_s: float, rate_hz: float
) -> F64:
    """Unit-variance noise (n, k) in time that forgets itself within the correlation time."""
    keep = float(np.exp(-1 / (correlation_s * rate_hz)))
    pushes = generator.standard_normal(shape)
    pushes[1:] *= np.sqrt(1 - keep**2)
    return np.asarray(signal.lfilter([1.0], [1.0, -keep], pushes, axis=0))


def _errors(
    generator: np.random.Generator,
    shape: tuple[int, ...],
    bias: float,
    density: float,
    grade: ImuGrade,
) -> F64:
    noise = density * np.sqrt(grade.rate_hz / 2) * generator.standard_normal(shape)
    return np.asarray(bias * generator.standard_normal(shape[1]) + noise)

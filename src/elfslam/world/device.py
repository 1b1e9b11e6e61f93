"""Phones: the sound they make, hear and the errors of their motion sensors."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F64, Value, array

BAND_LOW_HZ = 14_350.0
BAND_BINS = 630
BIN_HZ = 10.0
"""The simulator works on 630 bins of 10 Hz, 14.35 to 20.65 kHz: one 100 ms frame at 6.3 kHz."""


@dataclass(frozen=True)
class ImuGrade:
    """Errors of a motion sensor, one standard deviation each.

    A bias instability is the flat floor of the Allan deviation. `decimals` is to how many places
    the stream is rounded, in m/s2 and degrees per second; None leaves it as it is.
    """

    name: str
    rate_hz: float
    gyro_noise_radps_rthz: float
    gyro_bias_radps: float
    accel_noise_mps2_rthz: float
    accel_bias_mps2: float
    gyro_bias_instability_radps: float = 0.0
    decimals: int | None = None


BMI160 = ImuGrade(
    name="Bosch BMI160",
    rate_hz=100.0,
    gyro_noise_radps_rthz=np.deg2rad(0.007),
    gyro_bias_radps=np.deg2rad(0.1),
    accel_noise_mps2_rthz=180e-6 * 9.80665,
    accel_bias_mps2=0.040 * 9.80665,
)
"""Data sheet BST-BMI160-DS000: gyroscope noise 0.007 deg/s/rtHz, accelerometer noise 180 ug/rtHz
and offset 40 mg. The gyroscope's zero-rate offset drifts by 0.05 deg/s per kelvin; the phone's own
calibration removes it at rest, and 0.1 deg/s stands for 2 K of warming since then."""

PHONE_BIAS_INSTABILITY_RADPS = np.deg2rad(10.0 / 3600)
"""No data sheet below states one. Eleven Android phones had gyroscope biases of 5 to 20 deg/h
(doi 10.12265/j.gnss.2025047); 10 deg/h stands for them."""

LSM6DSO = ImuGrade(
    name="ST LSM6DSO",
    rate_hz=100.0,
    gyro_noise_radps_rthz=np.deg2rad(0.0038),
    gyro_bias_radps=np.deg2rad(0.02),
    accel_noise_mps2_rthz=70e-6 * 9.80665,
    accel_bias_mps2=0.020 * 9.80665,
    gyro_bias_instability_radps=PHONE_BIAS_INSTABILITY_RADPS,
)
"""Data sheet DS12140, table of mechanical characteristics: 3.8 mdps/rtHz, 70 ug/rtHz at 2 g, zero-g
offset 20 mg, zero-rate change 0.010 deg/s per kelvin (here times 2 K)."""

ICM20948 = ImuGrade(
    name="TDK InvenSense ICM-20948",
    rate_hz=100.0,
    gyro_noise_radps_rthz=np.deg2rad(0.015),
    gyro_bias_radps=np.deg2rad(0.1),
    accel_noise_mps2_rthz=230e-6 * 9.80665,
    accel_bias_mps2=0.025 * 9.80665,
    gyro_bias_instability_radps=PHONE_BIAS_INSTABILITY_RADPS,
)
"""Data sheet DS-000189 revision 1.3, tables 1 and 2: 0.015 deg/s/rtHz, 230 ug/rtHz, zero-g offset
25 mg (component), zero-rate change 0.05 deg/s per kelvin (here times 2 K)."""

BROWSER = replace(BMI160, name="browser on Bosch BMI160", rate_hz=60.0, decimals=1)
"""What a page gets by devicemotion: 60 Hz, rounded to 0.1 m/s2 and 0.1 deg/s."""


@dataclass(frozen=True, eq=False)
class Device(Value):
    """An acoustic phone: loudspeaker and microphone on one axis, with response and directivity.

    `response` is the product of both transducers over the 630 bins. A directivity b gives the gain
    (1 - b) + b cos(angle to the axis).
    """

    name: str
    response: F64 = array(BAND_BINS)
    separation_m: float = 0.15
    speaker_directivity: float = 0.35
    microphone_directivity: float = 0.2
    direct_gain: float = 0.6
    level: float = 0.035
    noise_rms: float = 2e-5


def smooth_response(generator: np.random.Generator, ripple_db: float, bumps: int = 5) -> F64:
    """A random smooth response (630) whose ripple spans about `ripple_db` from peak to peak."""
    x = np.linspace(0.0, 1.0, BAND_BINS)
    order = np.arange(1, bumps + 1)
    weights = generator.standard_normal(bumps) / order**0.5
    phase = generator.uniform(0, 2 * np.pi, bumps)
    curve = (weights[:, None] * np.cos(np.pi * order[:, None] * x + phase[:, None])).sum(axis=0)
    curve = (curve - curve.mean()) / max(float(np.ptp(curve)), 1e-9) * ripple_db
    return np.asarray(10 ** (curve / 20))


def named_device(name: str) -> Device:
    """The built-in phone: 10 dB of ripple, fixed for all time."""
    return Device(name=name, response=smooth_response(np.random.default_rng(160), 10.0))

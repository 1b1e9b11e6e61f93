"""Step detection: peaks of the vertical acceleration in the band of walking."""

from __future__ import annotations

import numpy as np
from scipy import signal

from elfslam.base.arrays import F64, I64
from elfslam.base.values import Imu
from elfslam.stages.motion.level import GRAVITY_MPS2, Level, averaged
from elfslam.stages.motion.parameters import MotionParameters
from elfslam.stages.motion.pieces import levelled_pieces


def find_footsteps(imu: Imu, parameters: MotionParameters) -> F64:
    """Times (n) of the footfalls, s: peaks of the vertical acceleration in the footstep band.

    Raises InputError as `levelled_pieces` does; a walk without footsteps gives no times.
    """
    pieces = levelled_pieces(imu, parameters)
    return np.concatenate([footfalls(piece, parameters) for piece in pieces])


def footfalls(levelled: Level, parameters: MotionParameters) -> F64:
    """Times (n) of the footfalls, s, of levelled sensors."""
    t_s, rate_hz = levelled.t_s, levelled.rate_hz
    bounce = vertical_bounce(levelled, parameters)
    span = 2 * np.sqrt(2) * bounce_rms(bounce, parameters.bounce_window_s, rate_hz)
    wanted = np.maximum(parameters.least_bounce_mps2, parameters.relative_bounce * span)
    peaks, found = signal.find_peaks(
        bounce,
        distance=max(1, round(parameters.least_interval_s * rate_hz)),
        prominence=parameters.least_bounce_mps2,
    )
    kept = peaks[found["prominences"] >= wanted[peaks]]
    return np.asarray(t_s[kept] + _peak_offset(bounce, kept) / rate_hz)


def vertical_bounce(levelled: Level, parameters: MotionParameters) -> F64:
    """The vertical acceleration (n) in the footstep band, m/s2."""
    vertical = np.sum(levelled.accel_mps2 * levelled.up, axis=1) - GRAVITY_MPS2
    band = (parameters.cadence_low_hz, parameters.cadence_high_hz)
    sos = signal.butter(2, band, "bandpass", fs=levelled.rate_hz, output="sos")
    return np.asarray(signal.sosfiltfilt(sos, vertical))


def bounce_rms(bounce: F64, window_s: float, rate_hz: float) -> F64:
    """Root mean square (n) of the bounce over a window; that of a sinusoid spans 2.8 times it."""
    return np.asarray(np.sqrt(np.maximum(averaged(bounce**2, window_s, rate_hz), 0.0)))


def _peak_offset(signal_rows: F64, peaks: I64) -> F64:
    """Where the parabola through a peak and its neighbours is highest, in samples from it."""
    before, at, after = (signal_rows[peaks + shift] for shift in (-1, 0, 1))
    return np.asarray((before - after) / np.minimum(2 * (before - 2 * at + after), -1e-12))

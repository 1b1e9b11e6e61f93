"""Pictures of how sound measures steps: walls come into focus, and ranges change with the walk."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_RATE_HZ, Chirp, Echoes, Odometry
from elfslam.line.acoustic_odometry import (
    SAMPLES_PER_BIN,
    AcousticOdometryParameters,
    loudness,
    windows,
)
from elfslam.score.scale_figures import Picture

DIRECTIONS = 120
FIRST_S = DISCARDED_SAMPLES / ECHO_RATE_HZ
APART = 3
"""Chirps from one to the other of two frames that are compared."""
RATIOS = np.linspace(-1.6, 1.6, 161)
LEAST_MOVE_M = 0.2


def picture(echoes: Echoes, odometry: Odometry, chirp: Chirp, scale: float, which: int) -> Picture:
    """Walls by direction and distance as the frames of one window pile up at this scale."""
    parameters = AcousticOdometryParameters()
    bin_m = parameters.sound_mps / ECHO_RATE_HZ * SAMPLES_PER_BIN / 2
    rows, moves_m = list(windows(echoes.t_s + parameters.ahead_s, odometry, parameters))[which]
    loud = loudness(echoes.samples[rows], chirp)
    angle = np.linspace(0.0, 2 * np.pi, DIRECTIONS, endpoint=False)
    nearer = scale * moves_m @ np.stack([np.cos(angle), np.sin(angle)]) / bin_m
    strength = [_piled(loud, bins) for bins in np.rint(nearer.T).astype(np.int64)]
    first_m = FIRST_S * parameters.sound_mps / 2
    distance_m = np.asarray(first_m + bin_m * np.arange(loud.shape[1]), np.float64)
    return Picture(angle, distance_m, np.array(strength, np.float32))


def _piled(loud: F32, nearer: I64) -> F64:
    """Mean of the frames (n, bins), each put back by as many bins as the wall came nearer."""
    count, bins = loud.shape
    piled, held = np.zeros(bins), np.full(bins, 1e-9)
    for row, by in zip(loud, nearer, strict=True):
        to, of = slice(max(by, 0), bins + min(by, 0)), slice(max(-by, 0), bins - max(by, 0))
        piled[to] += row[of]
        held[to] += 1
    return np.where(held > count / 3, piled / held, 0.0)


def range_changes(echoes: Echoes, odometry: Odometry, chirp: Chirp, scale: float) -> F64:
    """How alike two frames are (161) when one is put back by RATIOS times their true move.

    A wall straight ahead comes nearer by the whole move, at -1; one behind goes away, at 1.
    """
    parameters = AcousticOdometryParameters()
    bin_m = parameters.sound_mps / ECHO_RATE_HZ * SAMPLES_PER_BIN / 2
    alike = np.zeros(len(RATIOS))
    for rows, moves_m in windows(echoes.t_s + parameters.ahead_s, odometry, parameters):
        spectra = np.fft.rfft(loudness(echoes.samples[rows], chirp), 2048, axis=1)
        lagged = np.fft.irfft(np.conj(spectra[:-APART]) * spectra[APART:], axis=1)
        moved_m = scale * np.linalg.norm(moves_m[APART:] - moves_m[:-APART], axis=1)
        lags = np.arange(-256, 256)
        for row, far_m in zip(lagged[:, lags], moved_m, strict=True):
            if far_m > LEAST_MOVE_M:
                alike += np.interp(RATIOS * far_m / bin_m, lags, row)
    return alike / max(float(alike.max()), 1e-9)

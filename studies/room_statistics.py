"""Statistics of room impulse responses between 15.2 and 19.8 kHz: is their echo window diffuse?

Kurtosis 3 and a spread of 5.6 dB are a diffuse field (Gaussian samples, Rayleigh envelope); sparse
reflections have more. The windows are delays after the direct sound.
"""

from __future__ import annotations

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64

BAND_HZ = (15_200.0, 19_800.0)
WINDOWS_MS = ((11, 20), (20, 35), (35, 60))
LENGTH_S = 0.062
"""Of a response from its direct sound on; longer ones are cut to what simulated ones have."""
LOCAL_SAMPLES = 96
ENVELOPE_STEP, ENVELOPE_LOCAL = 8, 15
DECAY_FROM_S = 0.005
BLOCK_S = 0.002
BLOCK_MEDIAN = 1.05
"""Mean energy of a block of a diffuse field over the exponential of its mean logarithm."""


def banded(responses: F64, rate_hz: int) -> F64:
    """Responses (n, samples) from their direct sound on, between 15.2 and 19.8 kHz."""
    sections = signal.butter(6, BAND_HZ, "bandpass", fs=rate_hz, output="sos")
    kept = responses[:, : round(LENGTH_S * rate_hz)]
    return np.asarray(signal.sosfiltfilt(sections, kept, axis=1))


def kurtosis(band: F64, rate_hz: int) -> list[float]:
    """Of the samples over their local root mean square, in each window."""
    local = np.sqrt(np.maximum(_local_mean(band**2, LOCAL_SAMPLES), 1e-30))
    parts = [(band / local)[:, _samples(window, rate_hz)] for window in WINDOWS_MS]
    return [float(np.mean(part**4) / np.mean(part**2) ** 2) for part in parts]


def spread_db(band: F64, rate_hz: int) -> list[float]:
    """Root mean square of the envelope's level about its local mean, in each window."""
    envelope = np.abs(signal.hilbert(band, axis=1))[:, ::ENVELOPE_STEP]
    level_db = 20 * np.log10(envelope + 1e-12)
    about = level_db - _local_mean(level_db, ENVELOPE_LOCAL)
    rate = rate_hz / ENVELOPE_STEP
    return [float(np.sqrt(np.mean(about[:, _samples(w, rate)] ** 2))) for w in WINDOWS_MS]


def reverberation_s(band: F64, rate_hz: int) -> float:
    """Median T60 by the slope of Schroeder's integral from -5 to -20 dB, or as far as it goes.

    What would follow the cut is added as an exponential tail (ISO 3382-1:2009, 5.3.3).
    """
    return float(np.nanmedian([_reverberation_s(row, rate_hz) for row in band]))


def _reverberation_s(response: F64, rate_hz: int) -> float:
    energy = response[round(DECAY_FROM_S * rate_hz) :] ** 2
    block = round(BLOCK_S * rate_hz)
    blocks = energy[: len(energy) // block * block].reshape(-1, block).mean(axis=1)
    late = blocks[len(blocks) // 3 :]
    at = np.arange(len(late)) * block
    slope, _ = np.polyfit(at, np.log(late + 1e-30), 1)
    tail = np.exp(np.log(late + 1e-30).mean() + slope * (at[-1] + block / 2 - at.mean()))
    tail *= BLOCK_MEDIAN / max(-slope, 1e-6)
    level_db = 10 * np.log10(np.cumsum(energy[::-1])[::-1] + tail)
    level_db -= level_db[0]
    fitted = np.flatnonzero((level_db < -5.0) & (level_db > -20.0))
    if len(fitted) < 2:
        return float("nan")
    return -60.0 / float(np.polyfit(fitted / rate_hz, level_db[fitted], 1)[0])


def contrast(here: F64 | F32, moved: F64 | F32) -> float:
    """How much alike features (n, d) stay when each place is moved a little: 1 all, 0 nothing.

    Mean cosine of a place and the place moved, minus that of different places, over 1 minus it.
    """
    others = (here @ here.T)[~np.eye(len(here), dtype=bool)].mean()
    return float(((here * moved).sum(axis=1).mean() - others) / (1 - others))


def _samples(window_ms: tuple[int, int], rate_hz: float) -> slice:
    return slice(round(window_ms[0] * rate_hz / 1000), round(window_ms[1] * rate_hz / 1000))


def _local_mean(values: F64, size: int) -> F64:
    kernel = np.ones((1, size)) / size
    return np.asarray(signal.fftconvolve(values, kernel, mode="same", axes=1))

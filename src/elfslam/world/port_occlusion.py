"""A hand or a case over the port of a phone: what it takes of all that passes the port."""

from __future__ import annotations

import numpy as np
from scipy import fft

from elfslam.base.arrays import F64
from elfslam.world.device import BAND_BINS
from elfslam.world.pulses import BASEBAND_HZ, C64

COVER_DB = (6.0, 20.0)
"""Taken at 17.5 kHz by one cover or another."""
COVER_TILT_PER_HZ = 0.3 / 2_500.0
"""Of the loss in dB: 0.7 of it at 15 kHz, 1.3 at 20. An estimate: fingers and cases leave slits,
which let the longer waves pass."""


def port_occlusion(envelopes: C64, covered_db: F64) -> C64:
    """Envelopes (n, 630) of what passes a port that so much (n, dB at 17.5 kHz) is taken from.

    Without any cover they are those given.
    """
    rows = np.flatnonzero(covered_db)
    if not len(rows):
        return envelopes
    from_carrier_hz = fft.fftfreq(BAND_BINS, 1 / BASEBAND_HZ)
    loss_db = np.multiply.outer(covered_db[rows], 1 + COVER_TILT_PER_HZ * from_carrier_hz)
    gain = (10 ** (-loss_db / 20)).astype(np.float32)
    out = envelopes.copy()
    out[rows] = fft.ifft(fft.fft(envelopes[rows], axis=1) * gain, axis=1)
    return out

"""Matched filter, and its envelope by the analytic signal.

At 17.5 kHz one cycle is 2.5 samples, so a raw correlation peak picks the wrong cycle: the search
runs on the envelope of the analytic matched filter.
"""

from __future__ import annotations

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32
from elfslam.base.values import ECHO_RATE_HZ, Chirp

FILTERED_AT_ONCE = 1 << 20
"""Samples: what the matched filter needs of memory does not grow with the walk."""


def matched_envelope(samples: F32, chirp: Chirp) -> F32:
    """Envelope of the analytic matched filter (n,): value k belongs to a chirp that starts at k."""
    template = chirp.samples.astype(np.float64)
    if chirp.rate_hz != ECHO_RATE_HZ:
        template = signal.resample(template, round(len(template) * ECHO_RATE_HZ / chirp.rate_hz))
    analytic = signal.hilbert(template) / np.sum(template**2)
    kernel = np.conj(analytic[::-1]).astype(np.complex64)
    envelope = np.empty(len(samples), dtype=np.float32)
    for first in range(0, len(samples), FILTERED_AT_ONCE):
        block = samples[first : first + FILTERED_AT_ONCE + len(kernel) - 1]
        filtered = signal.oaconvolve(block, kernel, mode="full")[len(kernel) - 1 :]
        envelope[first : first + FILTERED_AT_ONCE] = np.abs(filtered[:FILTERED_AT_ONCE])
    return envelope

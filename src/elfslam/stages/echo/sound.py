"""The sound as echo cutting wants it: fit for measuring, at 44.1 kHz."""

from __future__ import annotations

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_RATE_HZ, Audio
from elfslam.stages.echo.parameters import EchoParameters

RESAMPLED_RATE_HZ = 48_000
HALF_SUPPORT = 96
"""Samples of the lower rate on either side."""
RESAMPLED_AT_ONCE = 1 << 20
"""Samples: what resampling needs of memory does not grow with the walk."""


def check_audio(audio: Audio, parameters: EchoParameters) -> None:
    """Refuse sound in which no echo can be measured."""
    samples = audio.samples[0]
    duration_s = len(samples) / audio.rate_hz
    if duration_s < parameters.minimum_duration_s:
        raise InputError(
            f"audio: wanted at least {parameters.minimum_duration_s:g} s, "
            f"got {duration_s:.2f} s; record longer"
        )
    if float(np.abs(samples).max()) < 1e-6:
        raise InputError("audio: it is silent; check that the microphone was on and not muted")
    clipped = float(np.mean(np.abs(samples) >= 0.999))
    if clipped > parameters.clipped_share:
        raise InputError(
            f"audio: {clipped:.1%} of the samples are clipped; "
            "lower the volume or the gain and record again"
        )


def to_echo_rate(audio: Audio) -> F32:
    """Channel 0 at 44.1 kHz, resampled from 48 kHz, flat from 15 to 20 kHz."""
    samples: F32 = audio.samples[0]
    if audio.rate_hz == ECHO_RATE_HZ:
        return samples
    if audio.rate_hz != RESAMPLED_RATE_HZ:
        raise InputError(
            f"audio: wanted {ECHO_RATE_HZ} or {RESAMPLED_RATE_HZ} Hz, got {audio.rate_hz}; "
            "record again at one of the two"
        )
    return resampled(samples, 147, 160)


def resampled(samples: F32, up: int, down: int) -> F32:
    """Samples (n) at `up / down` of their rate by a long filter, flat to 0.95 of the new band."""
    taps = signal.firwin(2 * HALF_SUPPORT * down + 1, 1.0 / down, window=("kaiser", 10.0))
    margin, step = (HALF_SUPPORT + 1) * down, RESAMPLED_AT_ONCE // down * down
    made = np.empty(-(-len(samples) * up // down), dtype=np.float32)
    for first in range(0, len(samples), step):
        start, at = max(first - margin, 0), first // down * up
        block = signal.resample_poly(samples[start : first + step + margin], up, down, window=taps)
        inside = block[(first - start) // down * up :][: step // down * up]
        made[at : at + len(inside)] = inside[: len(made) - at]
    return made

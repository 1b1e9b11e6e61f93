"""The sound as echo cutting wants it: fit for measuring, at 44.1 kHz."""

from __future__ import annotations

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_RATE_HZ, Audio
from elfslam.line.echo.parameters import EchoParameters

RESAMPLED_RATE_HZ = 48_000


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
    """Channel 0 at 44.1 kHz, resampled from 48 kHz by a long filter, flat from 15 to 20 kHz."""
    samples: F32 = audio.samples[0]
    if audio.rate_hz == ECHO_RATE_HZ:
        return samples
    if audio.rate_hz != RESAMPLED_RATE_HZ:
        raise InputError(
            f"audio: wanted {ECHO_RATE_HZ} or {RESAMPLED_RATE_HZ} Hz, got {audio.rate_hz}; "
            "record again at one of the two"
        )
    up, down = 147, 160
    taps = signal.firwin(96 * 2 * down + 1, 1.0 / down, window=("kaiser", 10.0))
    return np.asarray(signal.resample_poly(samples, up, down, window=taps), dtype=np.float32)

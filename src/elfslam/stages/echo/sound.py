"""The sound as echo cutting wants it: fit for measuring, at 44.1 kHz, and its matched filter.

At 17.5 kHz one cycle is 2.5 samples, so a raw correlation peak picks the wrong cycle: the search
runs on the envelope of the analytic matched filter.
"""

from dataclasses import dataclass

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import ECHO_RATE_HZ, Audio, Chirp


@dataclass(frozen=True)
class EchoParameters:
    """How the direct arrival is recognised, and what is refused."""

    minimum_duration_s: float = parameter(2.0, "s", "shorter audio is refused", 0.2, 3600.0)
    contrast: float = parameter(
        8.0, "", "direct arrival over the frame's median envelope", 1.0, 1000.0
    )
    level_share: float = parameter(0.35, "", "direct arrival over its typical level", 0.01, 1.0)
    jump_share: float = parameter(
        0.2, "", "more jumps than this per chirp mean another rate or period", 0.0, 1.0
    )
    early_share: float = parameter(
        0.5, "", "an earlier peak this strong is the direct one", 0.01, 1.0
    )
    early_s: float = parameter(0.0015, "s", "how far before the strongest peak to look", 0.0, 0.02)
    slack_s: float = parameter(0.002, "s", "jitter of the direct arrival between frames", 0.0, 0.02)
    latest_s: float = parameter(
        2.5, "s", "longest time from playing to hearing a chirp of a schedule", 0.1, 5.0
    )
    found_share: float = parameter(0.5, "", "frames that must hold a chirp", 0.0, 1.0)
    clipped_share: float = parameter(0.001, "", "more samples at full scale are refused", 0.0, 1.0)
    seam_contrast: float = parameter(
        9.0, "", "click over the usual that may be a break of the stream", 1.0, 1e6
    )
    shortfall_s: float = parameter(
        0.15, "s", "sound may be this much shorter than motion, jumps put back", 0.0, 60.0
    )


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

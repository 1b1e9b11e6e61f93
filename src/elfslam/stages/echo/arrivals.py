"""The direct arrivals of chirps that are played once per period.

The direct path is found anew in every frame, because the offset between playing and recording
differs between runs and can jump.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, I64, Bool
from elfslam.base.errors import InputError, ParameterError
from elfslam.base.values import ECHO_RATE_HZ
from elfslam.stages.echo.parameters import EchoParameters

LULL_S = (0.070, 0.005)
"""Behind a direct arrival its echoes are over after the first, and the next chirp is not yet
due the second before the period ends: nothing as loud as a chirp belongs there."""
SILENT_SHARE = 1e-6
"""Of the loudest; what the matched filter leaves of a chirp in digital silence is less."""


@dataclass(frozen=True)
class Arrivals:
    """Direct arrivals as sample indices, and jumps: (index of the arrival behind it, samples)."""

    samples: I64
    jumps: tuple[tuple[int, int], ...]


def find_arrivals(envelope: F32, period: int, parameters: EchoParameters) -> Arrivals:
    """Sample indices of the direct arrivals, followed from frame to frame."""
    slack = round(parameters.slack_s * ECHO_RATE_HZ)
    early = round(parameters.early_s * ECHO_RATE_HZ)
    check_search(slack + early, len(envelope), period)
    level = _direct_level(envelope, period, parameters)
    found: list[int] = []
    jumps: list[tuple[int, int]] = []
    expected = strongest(envelope, 0, period)
    while expected < len(envelope):
        peak = strongest(envelope, expected - slack, expected + slack + 1)
        if envelope[peak] < level:
            peak = strongest(envelope, expected - period // 2, expected + period // 2)
            if envelope[peak] < level:
                expected += period
                continue
            if found:
                jumps.append((len(found), (expected - peak) % period))
        direct = earliest(envelope, peak, early, parameters.early_share)
        found.append(direct)
        expected = direct + period
    silent = int(np.sum(~sounding(envelope, period)))
    _check_found(len(found), len(envelope) / period - silent, parameters)
    arrivals = Arrivals(np.array(found, dtype=np.int64), tuple(jumps))
    _check_beat(arrivals, envelope, period, parameters)
    return arrivals


def sounding(envelope: F32, period: int) -> Bool:
    """Which whole periods (n) hold any sound: where a phone kept none there is digital silence."""
    loudest = _by_period(envelope, period).max(axis=1, initial=0.0)
    return np.asarray(loudest >= SILENT_SHARE * loudest.max(initial=0.0))


def _by_period(envelope: F32, period: int) -> F32:
    return envelope[: len(envelope) // period * period].reshape(-1, period)


def check_search(reach: int, count: int, period: int) -> None:
    """The search goes on to the next chirp only while it reaches back less than half a period."""
    if reach >= period // 2:
        raise ParameterError(
            f"echo.slack_s + echo.early_s: wanted less than half of chirp.period_s, "
            f"{period / ECHO_RATE_HZ / 2:g} s, got {reach / ECHO_RATE_HZ:g} s; lower one"
        )
    if count < 2 * period:
        raise InputError(
            f"audio: wanted at least two periods of {period / ECHO_RATE_HZ:g} s, "
            f"got {count / ECHO_RATE_HZ:.2f} s; record longer, or check chirp.period_s"
        )


def _direct_level(envelope: F32, period: int, parameters: EchoParameters) -> float:
    frames = _by_period(envelope, period)[sounding(envelope, period)]
    peak = float(np.median(frames.max(axis=1)))
    floor = float(np.median(np.median(frames, axis=1)))
    if peak < parameters.contrast * max(floor, 1e-9):
        raise InputError(
            "audio: no chirps in the 15-20 kHz band; turn echo cancellation and noise suppression "
            "off, the media volume up, and record again"
        )
    return parameters.level_share * peak


def _check_found(found: int, frames: float, parameters: EchoParameters) -> None:
    if found < max(parameters.found_share * frames, 1):
        raise InputError(
            f"audio: chirps in {found} of {frames:.0f} frames, "
            f"wanted {parameters.found_share:.0%}; check that the loudspeaker played all the time"
        )


def _check_beat(arrivals: Arrivals, envelope: F32, period: int, parameters: EchoParameters) -> None:
    """Refuse chirps that come at another rate than the period says, or several to a period."""
    beat = _beat(arrivals.samples, envelope, period)
    unsteady = len(arrivals.jumps) > parameters.jump_share * len(arrivals.samples)
    if unsteady or not 0.75 * period < beat < 1.5 * period:
        raise InputError(
            f"audio: chirps come every {beat / ECHO_RATE_HZ * 1000:.1f} ms, "
            "not at the period of the chirp; "
            "check the rate that the file claims, and chirp.period_s"
        )


def _beat(found: I64, envelope: F32, period: int) -> float:
    """Samples from a typical chirp to the next one that is heard, found or not."""
    whole = found[found + period <= len(envelope)]
    between = np.arange(round(LULL_S[0] * ECHO_RATE_HZ), period - round(LULL_S[1] * ECHO_RATE_HZ))
    if not len(whole) or not len(between):
        return period
    behind = envelope[whole[:, None] + between]
    if np.median(behind.max(axis=1)) > 0.5 * np.median(envelope[whole]):
        return float(between[0] + np.median(behind.argmax(axis=1)))
    return float(np.median(np.diff(found))) if len(found) > 1 else period


def strongest(envelope: F32, start: int, stop: int) -> int:
    """Sample of the greatest value from `start` to `stop`, without the last."""
    start = max(start, 0)
    return start + int(np.argmax(envelope[start:stop]))


def earliest(envelope: F32, peak: int, early: int, share: float) -> int:
    """The first peak at most `early` samples before `peak` that has a `share` of it, or `peak`."""
    start = max(peak - early, 1)
    window = envelope[start - 1 : peak + 1]
    rising = (window[1:-1] >= window[:-2]) & (window[1:-1] > window[2:])
    strong = np.flatnonzero(rising & (window[1:-1] >= share * envelope[peak]))
    return start + int(strong[0]) if len(strong) else peak

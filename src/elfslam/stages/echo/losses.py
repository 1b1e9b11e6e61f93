"""Where sound was lost, and when the arrivals behind it were."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage, signal

from elfslam.base.arrays import F32, F64
from elfslam.base.values import ECHO_RATE_HZ
from elfslam.stages.echo.arrivals import Arrivals
from elfslam.stages.echo.frames import Frames
from elfslam.stages.echo.parameters import EchoParameters

SEAM_BAND_HZ = 20_800.0
"""Above the chirp; a break in the waveform reaches there, room noise hardly does."""

SLIGHTEST_JUMP = 8
"""Samples; the direct arrival, median of seven, stands still to less than that."""

SMOOTH = 45
"""Samples, a millisecond: how quiet a frame is changes no faster."""

FRAMES_THAT_TELL = 2000
"""How quiet a frame usually is: what that needs of memory does not grow with the walk."""


def _jumped_s(arrivals: Arrivals) -> float:
    return sum(jump for _, jump in arrivals.jumps) / ECHO_RATE_HZ


def _with_slight_jumps(arrivals: Arrivals, period: int) -> Arrivals:
    """Arrivals with the jumps that hide in the jitter: lasting steps against the beat.

    Nearly whole periods were lost there. A third break changes nothing: two are not told apart.
    """
    moved = np.diff(arrivals.samples, prepend=arrivals.samples[0])
    moved -= period * np.round(moved / period).astype(np.int64)
    jumps = dict(arrivals.jumps)
    moved[list(jumps)] = 0
    beat = np.cumsum(moved).astype(np.float64)
    while len(jumps) < 2:
        k, step = _greatest_step(beat)
        if abs(step) <= SLIGHTEST_JUMP:
            break
        jumps[k] = round(-step) % period
        beat[k:] -= step
    return Arrivals(arrivals.samples, tuple(sorted(jumps.items())))


def _greatest_step(beat: F64) -> tuple[int, float]:
    """Where the median of seven steps most, and by how much; the sharpest place among equals."""
    steps = [
        float(np.median(beat[k : k + 7]) - np.median(beat[max(k - 7, 0) : k]))
        for k in range(1, len(beat))
    ]
    sharpness = np.abs(steps) + np.abs(np.diff(beat))
    k = int(np.argmax(sharpness)) + 1 if steps else 0
    return k, steps[k - 1] if steps else 0.0


def _clicked(
    arrivals: Arrivals, samples: F32, period: int, parameters: EchoParameters
) -> int | None:
    """The first arrival behind a break that no jump tells of; None where there is none.

    Where whole periods are lost the beat stays, but the waveform breaks: a click above the chirp
    band, where a frame is otherwise as quiet as the frames around it. Several jumps need no click.
    """
    whole = arrivals.samples[arrivals.samples + period <= len(samples)]
    if len(arrivals.jumps) > 1 or not len(whole):
        return None
    highpass = signal.butter(8, SEAM_BAND_HZ, "highpass", fs=ECHO_RATE_HZ, output="sos")
    sharp = np.abs(signal.sosfiltfilt(highpass, samples)).astype(np.float32)
    frames = np.lib.stride_tricks.sliding_window_view(sharp, period)
    usual = np.median(frames[whole[:: len(whole) // FRAMES_THAT_TELL + 1]], axis=0)
    usual = ndimage.uniform_filter1d(usual, SMOOTH, mode="wrap") + 1e-9  # few frames scatter
    excess = np.array([float((frames[start] / usual).max()) for start in whole])
    for jump, _ in arrivals.jumps:
        excess[max(jump - 2, 0) : jump + 1] = 0.0
    excess[[0, -1]] = 0.0  # the ends of the stream are breaks of their own
    clicks = np.flatnonzero(excess > parameters.seam_contrast)
    return int(clicks[0]) if len(clicks) else None


@dataclass(frozen=True)
class Breaks:
    """Where the stream broke: the arrival behind each break, and the seconds that were lost there.

    The times of the first `certain` arrivals are known; behind a break of which nobody knows how
    much was lost they are not.
    """

    lost: tuple[tuple[int, float], ...]
    certain: int


def arrival_times(
    frames: Frames, missing_s: float | None, parameters: EchoParameters
) -> tuple[F64, F64, int]:
    """Times of the arrivals, lost stretches put back; the losses (when, seconds); how many of the
    times are certain.

    `missing_s` is how much longer than the sound the other sensors ran.
    """
    period_s = frames.period_s
    t_s = frames.arrivals.samples / ECHO_RATE_HZ
    silences = _unheard(frames) if frames.scheduled else _silences(t_s, period_s)
    breaks = put_back(frames, missing_s, parameters)
    losses, jumped = [], set()
    for k, lost_s in breaks.lost:
        losses.append((t_s[k - 1] + period_s, lost_s))
        t_s[k:] += lost_s
        jumped.add(k)
    losses += [
        (t_s[k - 1] + period_s, lost_s)
        for k, lost_s in silences
        if k not in jumped and k < breaks.certain
    ]
    return t_s, np.array(sorted(losses), dtype=np.float64).reshape(-1, 2), breaks.certain


def put_back(frames: Frames, missing_s: float | None, parameters: EchoParameters) -> Breaks:
    """The breaks of the stream, measured against the other sensors.

    Sound that is merely shorter ended early. What its jumps do not explain may have been lost at
    any of them: only what came before is certain then.
    """
    arrivals, clicked = frames.arrivals, None
    too_short = (missing_s or 0.0) - _jumped_s(arrivals) > parameters.shortfall_s
    if too_short and not frames.scheduled:
        period = round(frames.period_s * ECHO_RATE_HZ)
        arrivals = _with_slight_jumps(arrivals, period)
        clicked = _clicked(arrivals, frames.samples, period, parameters)
    breaks = _lost_at_jumps(arrivals, frames, missing_s, parameters)
    if clicked is None:
        return breaks
    certain = min(clicked, breaks.certain, *(k for k, _ in arrivals.jumps))
    return Breaks(tuple(each for each in breaks.lost if each[0] < certain), certain)


def _unheard(frames: Frames) -> list[tuple[int, float]]:
    """The arrival after chirps that were played and not heard, and for how long that was so."""
    rows = np.flatnonzero(frames.found >= 0)
    waits = [(int(frames.found[b]), b - a - 1) for a, b in pairwise(rows)]
    return [(k, missed * frames.period_s) for k, missed in waits if missed > 0]


def _lost_at_jumps(
    arrivals: Arrivals, frames: Frames, missing_s: float | None, parameters: EchoParameters
) -> Breaks:
    """What was lost at each jump.

    A jump tells what was lost up to whole periods. One jump takes the whole periods that are
    missing beyond it; among several nobody knows which, so then the jumps alone must explain what
    is missing. Where nothing is missing the jumps are no losses: playing fell behind recording.
    """
    count, jumps = len(arrivals.samples), arrivals.jumps
    lost = tuple((k, jump / ECHO_RATE_HZ) for k, jump in jumps)
    jumped_s = sum(lost_s for _, lost_s in lost)
    if missing_s is None:
        return Breaks(lost, count)
    if missing_s < jumped_s / 2:
        lost, jumped_s = tuple((k, 0.0) for k, _ in jumps), 0.0
    elif len(jumps) == 1:
        period_s = frames.period_s
        jumped_s += max(round((missing_s - jumped_s) / period_s), 0) * period_s
        lost = ((jumps[0][0], jumped_s),)
    explained = abs(missing_s - jumped_s) <= parameters.shortfall_s
    if explained or frames.scheduled or not jumps:
        return Breaks(lost, count)
    return Breaks((), jumps[0][0])


def _silences(t_s: F64, period_s: float) -> list[tuple[int, float]]:
    gaps = np.diff(t_s)
    return [(int(k) + 1, float(gaps[k]) - period_s) for k in np.flatnonzero(gaps > 1.5 * period_s)]

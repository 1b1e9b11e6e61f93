"""Where sound was lost, and when the arrivals behind it were."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy import signal

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import InputError
from elfslam.base.values import ECHO_RATE_HZ
from elfslam.line.echo.arrivals import Arrivals
from elfslam.line.echo.frames import Frames
from elfslam.line.echo.parameters import EchoParameters

SEAM_BAND_HZ = 20_800.0
"""Above the chirp; a break in the waveform reaches there, room noise hardly does."""

SLIGHTEST_JUMP = 8
"""Samples; the direct arrival, median of seven, stands still to less than that."""


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


def _check_alone(arrivals: Arrivals, samples: F32, period: int, parameters: EchoParameters) -> None:
    """Refuse a second break beside the only jump: either may have lost the whole periods.

    Where whole periods are lost the beat stays, but the waveform breaks: a click above the chirp
    band, where a frame is otherwise as quiet as the frames around it.
    """
    whole = arrivals.samples[arrivals.samples + period <= len(samples)]
    if len(arrivals.jumps) != 1 or not len(whole):
        return
    highpass = signal.butter(8, SEAM_BAND_HZ, "highpass", fs=ECHO_RATE_HZ, output="sos")
    sharp = np.abs(signal.sosfiltfilt(highpass, samples)).astype(np.float32)
    frames = np.lib.stride_tricks.sliding_window_view(sharp, period)[whole]
    excess = (frames / (np.median(frames, axis=0) + 1e-9)).max(axis=1)
    jump = arrivals.jumps[0][0]
    excess[max(jump - 2, 0) : jump + 1] = 0.0
    excess[[0, -1]] = 0.0  # the ends of the stream are breaks of their own
    clicked = int(np.argmax(excess))
    if excess[clicked] > parameters.seam_contrast:
        raise InputError(
            f"audio: sound was lost at {arrivals.samples[jump] / ECHO_RATE_HZ:.1f} s, but it "
            f"clicks at {whole[clicked] / ECHO_RATE_HZ:.1f} s too, so where how much was lost "
            "is unknown; record again, or raise echo.seam_contrast if that was a noise in the room"
        )


def arrival_times(
    frames: Frames, missing_s: float | None, parameters: EchoParameters
) -> tuple[F64, F64]:
    """Times of the arrivals with lost stretches put back, and the losses (when, seconds).

    `missing_s` is how much longer than the sound the other sensors ran.
    """
    period_s = frames.period_s
    t_s = frames.arrivals.samples / ECHO_RATE_HZ
    silences = _unheard(frames) if frames.scheduled else _silences(t_s, period_s)
    losses, jumped = [], set()
    for k, lost_s in put_back(frames, missing_s, parameters):
        losses.append((t_s[k - 1] + period_s, lost_s))
        t_s[k:] += lost_s
        jumped.add(k)
    losses += [(t_s[k - 1] + period_s, lost_s) for k, lost_s in silences if k not in jumped]
    return t_s, np.array(sorted(losses), dtype=np.float64).reshape(-1, 2)


def put_back(
    frames: Frames, missing_s: float | None, parameters: EchoParameters
) -> list[tuple[int, float]]:
    """The arrival after each break of the stream and the seconds that were lost there."""
    arrivals = frames.arrivals
    too_short = (missing_s or 0.0) - _jumped_s(arrivals) > parameters.shortfall_s
    if too_short and not frames.scheduled:
        period = round(frames.period_s * ECHO_RATE_HZ)
        arrivals = _with_slight_jumps(arrivals, period)
        _check_alone(arrivals, frames.samples, period, parameters)
    return _lost_at_jumps(arrivals.jumps, frames.period_s, missing_s, parameters)


def _unheard(frames: Frames) -> list[tuple[int, float]]:
    """The arrival after chirps that were played and not heard, and for how long that was so."""
    rows = np.flatnonzero(frames.found >= 0)
    waits = [(int(frames.found[b]), b - a - 1) for a, b in pairwise(rows)]
    return [(k, missed * frames.period_s) for k, missed in waits if missed > 0]


def _lost_at_jumps(
    jumps: tuple[tuple[int, int], ...],
    period_s: float,
    missing_s: float | None,
    parameters: EchoParameters,
) -> list[tuple[int, float]]:
    """The arrival after each jump and the seconds lost there.

    A jump tells what was lost up to whole periods. One jump takes the whole periods that are
    missing beyond it; among several nobody knows which, so then the jumps alone must explain what
    is missing. Where nothing is missing the jumps are no losses: playing fell behind recording.
    """
    lost = [(k, jump / ECHO_RATE_HZ) for k, jump in jumps]
    jumped_s = sum(lost_s for _, lost_s in lost)
    if missing_s is None:
        return lost
    if missing_s < jumped_s / 2:
        lost, jumped_s = [(k, 0.0) for k, _ in jumps], 0.0
    elif len(jumps) == 1:
        jumped_s += max(round((missing_s - jumped_s) / period_s), 0) * period_s
        lost = [(jumps[0][0], jumped_s)]
    _check_explained(missing_s - jumped_s, len(jumps), parameters.shortfall_s)
    return lost


def _check_explained(left_s: float, jumps: int, shortfall_s: float) -> None:
    """Refuse sound of which more was lost than its jumps tell, or of which they tell too much."""
    if -shortfall_s <= left_s <= shortfall_s or (left_s < 0 and jumps == 0):
        return
    where = f"beyond what its {jumps} breaks tell" if jumps else "and nothing tells where"
    how = "shorter" if left_s > 0 else "longer"
    raise InputError(
        f"audio: {abs(left_s):.2f} s {how} than the motion {where}, so its echoes cannot be timed; "
        "record again, or raise echo.shortfall_s if one merely ended before the other"
    )


def _silences(t_s: F64, period_s: float) -> list[tuple[int, float]]:
    gaps = np.diff(t_s)
    return [(int(k) + 1, float(gaps[k]) - period_s) for k in np.flatnonzero(gaps > 1.5 * period_s)]

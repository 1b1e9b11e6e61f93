"""What else was heard around each chirp: early sound, noise, clipping."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import ECHO_RATE_HZ, FrameFacts
from elfslam.stages.echo.arrivals import strongest
from elfslam.stages.echo.frames import Frames
from elfslam.stages.echo.losses import put_back
from elfslam.stages.echo.parameters import EchoParameters

QUIET = (round(0.020 * ECHO_RATE_HZ), round(0.002 * ECHO_RATE_HZ))
"""From how long before a direct arrival to how long before it nothing should be heard."""
OVER = round(0.065 * ECHO_RATE_HZ)
"""Behind a direct arrival its echoes are over."""
FULL_SCALE = 0.999


def frame_facts(
    frames: Frames,
    parameters: EchoParameters,
    duration_s: float | None = None,
    gain_db: F64 | None = None,
) -> FrameFacts:
    """What is known of every chirp (m) that was due, heard or not.

    `duration_s` is how long the other sensors ran, as for `cut_echoes`: the times agree. `gain_db`
    (m) is how loud each was played, where a schedule says so.
    """
    rows = np.array([_row(frames, k, parameters) for k in range(len(frames.due))])
    level, before, noise, clipped = rows.T
    t_s, late = _times(frames, parameters, duration_s)
    late_s = np.where(frames.found < 0, np.nan, late)
    return FrameFacts(t_s, late_s, level, before, noise, clipped, gain_db)


def _times(frames: Frames, parameters: EchoParameters, duration_s: float | None) -> tuple[F64, F64]:
    """When each chirp was due, lost stretches put back, and how late it was against that."""
    missing_s = None if duration_s is None else duration_s - len(frames.samples) / ECHO_RATE_HZ
    breaks = put_back(frames, missing_s, parameters)
    shift_s = np.zeros(len(frames.due))
    for k, lost_s in breaks.lost:
        shift_s[int(np.flatnonzero(frames.found == k)[0]) :] += lost_s
    arrived = frames.arrivals.samples[frames.found]
    return frames.due / ECHO_RATE_HZ + shift_s, (arrived - frames.due) / ECHO_RATE_HZ


def _row(frames: Frames, k: int, parameters: EchoParameters) -> tuple[float, ...]:
    """Level, what came before over it, noise, clipped share."""
    envelope, at = frames.envelope, _moment(frames, k, parameters)
    if not 0 <= at < len(envelope):
        return 0.0, 0.0, 0.0, 0.0
    begin = max(at - QUIET[0], _moment(frames, k - 1, parameters) + OVER if k else 0)
    quiet = envelope[max(begin, 0) : max(at - QUIET[1], 0)]
    sound = frames.samples[at : at + OVER]
    level = float(envelope[at])
    return (
        level,
        float(quiet.max()) / max(level, 1e-9) if len(quiet) else 0.0,
        float(np.median(quiet)) if len(quiet) else 0.0,
        float(np.mean(np.abs(sound) >= FULL_SCALE)),
    )


def _moment(frames: Frames, k: int, parameters: EchoParameters) -> int:
    """The direct arrival, or what is loudest about where it was due."""
    if frames.found[k] >= 0:
        return int(frames.arrivals.samples[frames.found[k]])
    due, slack = int(frames.due[k]), round(parameters.slack_s * ECHO_RATE_HZ)
    if not slack <= due < len(frames.envelope) - slack:
        return due
    return strongest(frames.envelope, due - slack, due + slack + 1)

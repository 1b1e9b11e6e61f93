"""Where every chirp of a recording was due, and where its direct sound arrived."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F32, F64, I64
from elfslam.base.values import ECHO_RATE_HZ, Audio, Chirp
from elfslam.stages.echo.arrivals import Arrivals, find_arrivals
from elfslam.stages.echo.channels import best_channel
from elfslam.stages.echo.envelope import matched_envelope
from elfslam.stages.echo.parameters import EchoParameters
from elfslam.stages.echo.schedule import find_scheduled
from elfslam.stages.echo.sound import check_audio, to_echo_rate


@dataclass(frozen=True, eq=False)
class Frames:
    """The sound (n) at 44.1 kHz, its matched envelope (n), and the direct arrivals (f) in it.

    `due` (m) is the sample at which each chirp was due, found or not, and `found` (m) the row of
    its direct arrival, -1 where there is none. `scheduled` says whether a schedule told that.
    """

    samples: F32
    envelope: F32
    arrivals: Arrivals
    due: I64
    found: I64
    period_s: float
    scheduled: bool


def find_frames(
    audio: Audio, chirp: Chirp, parameters: EchoParameters, played_t_s: F64 | None = None
) -> Frames:
    """The frames of the channel that hears the chirps best.

    `played_t_s` (m) says when each chirp was played. Raises InputError and ParameterError as
    `cut_echoes`.
    """
    audio = best_channel(audio, chirp)
    check_audio(audio, parameters)
    samples = to_echo_rate(audio)
    envelope = matched_envelope(samples, chirp)
    period = round(chirp.period_s * ECHO_RATE_HZ)
    if played_t_s is not None:
        arrivals, due, found = find_scheduled(envelope, played_t_s, period, parameters)
    else:
        arrivals = find_arrivals(envelope, period, parameters)
        due, found = _due_by_period(arrivals, period)
    scheduled = played_t_s is not None
    return Frames(samples, envelope, arrivals, due, found, chirp.period_s, scheduled)


def _due_by_period(arrivals: Arrivals, period: int) -> tuple[I64, I64]:
    """Chirps are due one period after the one before, or where the first one arrived."""
    due, found = [int(arrivals.samples[0])], [0]
    for k, (last, arrival) in enumerate(
        zip(arrivals.samples[:-1], arrivals.samples[1:], strict=True), start=1
    ):
        periods = max(round((int(arrival) - int(last)) / period), 1)
        due += [int(last) + period * step for step in range(1, periods + 1)]
        found += [-1] * (periods - 1) + [k]
    return np.array(due, dtype=np.int64), np.array(found, dtype=np.int64)

"""The echo trace behind every direct arrival."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F32, F64, Bool
from elfslam.base.errors import InputError
from elfslam.base.values import (
    DISCARDED_SAMPLES,
    ECHO_RATE_HZ,
    ECHO_SAMPLES,
    Audio,
    Chirp,
    Echoes,
)
from elfslam.stages.echo.frames import Frames, find_frames
from elfslam.stages.echo.losses import arrival_times
from elfslam.stages.echo.parameters import EchoParameters


def cut_echoes(
    audio: Audio,
    chirp: Chirp,
    parameters: EchoParameters,
    duration_s: float | None = None,
    played_t_s: F64 | None = None,
) -> Echoes:
    """Aligned echo traces (n, 2352), one per chirp that was found in the best channel.

    `duration_s` is how long the other sensors ran: it tells how much sound was lost where the
    stream jumps, which the phase of the chirps gives only up to whole periods. `played_t_s` (m)
    says when each chirp was played, up to a constant; without it they come once per period.
    What lies behind a loss that cannot be put back is left out. Raises InputError for sound that
    is too short, silent, clipped or holds no chirps; ParameterError for a search wider than the
    period.
    """
    frames = find_frames(audio, chirp, parameters, played_t_s)
    return echoes_of(frames, parameters, duration_s)


def echoes_of(
    frames: Frames,
    parameters: EchoParameters,
    duration_s: float | None = None,
    spoiled: Bool | None = None,
) -> Echoes:
    """The echo traces of frames that were found, as `cut_echoes`; those `spoiled` (n) left out."""
    samples, arrivals = frames.samples, frames.arrivals.samples
    missing_s = None if duration_s is None else duration_s - len(samples) / ECHO_RATE_HZ
    t_s, losses_s, certain = arrival_times(frames, missing_s, parameters)
    starts = arrivals + DISCARDED_SAMPLES
    heard = np.array([_holds_echo(samples, start) for start in starts])
    if not heard.any():
        raise InputError("audio: it ends before the first echo does; record longer")
    heard[certain:] = False
    if not heard.any():
        raise InputError(
            "audio: sound was lost at its beginning and nothing tells how much, so its echoes "
            "cannot be timed; record again"
        )
    if spoiled is not None:
        heard &= ~spoiled
    if not heard.any():
        raise InputError(
            "audio: other phones chirp into every echo; record where fewer do, or wait your turn"
        )
    traces = np.stack([samples[start : start + ECHO_SAMPLES] for start in starts[heard]])
    return Echoes(t_s[heard], traces, losses_s)


def _holds_echo(samples: F32, start: int) -> bool:
    """Whether the stream goes on behind a direct arrival, and not in digital silence."""
    trace = samples[start : start + ECHO_SAMPLES]
    return len(trace) == ECHO_SAMPLES and bool(trace.any())

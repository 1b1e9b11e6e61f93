"""Which channel of a sound hears the chirps best: phones have microphones that hear little."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.values import ECHO_RATE_HZ, Audio, Chirp
from elfslam.stages.echo.arrivals import sounding
from elfslam.stages.echo.envelope import matched_envelope
from elfslam.stages.echo.sound import to_echo_rate

EXCERPTS, EXCERPT_S = 24, 1.0
"""Looked at all along the sound: what the choice needs does not grow with the walk."""
HEARD_QUANTILE = 0.9
"""Of the frames of a period; a chirp need not be in each of them."""


def best_channel(audio: Audio, chirp: Chirp) -> Audio:
    """The one channel (1, n) in which the matched filter's peaks stand out most from its floor."""
    if len(audio.samples) == 1:
        return audio
    length = round(EXCERPT_S * audio.rate_hz)
    last = max(audio.samples.shape[1] - length, 0)
    starts = np.unique(np.linspace(0, last, EXCERPTS).astype(np.int64))
    contrasts = [
        _contrast([row[start : start + length] for start in starts], audio.rate_hz, chirp)
        for row in audio.samples
    ]
    best = int(np.argmax(contrasts))
    return replace(audio, samples=audio.samples[best : best + 1])


def _contrast(excerpts: list[F32], rate_hz: int, chirp: Chirp) -> float:
    period = round(chirp.period_s * ECHO_RATE_HZ)
    envelopes = (
        matched_envelope(to_echo_rate(Audio(each[None], rate_hz)), chirp) for each in excerpts
    )
    frames = np.concatenate([each[: len(each) // period * period] for each in envelopes])
    frames = frames.reshape(-1, period)[sounding(frames, period)]
    if not len(frames):
        return 0.0
    peak = np.quantile(frames.max(axis=1), HEARD_QUANTILE)
    return float(peak / max(np.median(frames), 1e-9))

"""Automatic gain of a recorder, as phones have that do not let themselves be told to leave it."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from elfslam.base.arrays import F32
from elfslam.base.errors import InputError

LEVEL_S = 0.002
"""Time constant of the power that is looked at."""
SILENCE = 1e-20
"""Power below which nothing more is told apart."""


@dataclass(frozen=True)
class GainControl:
    """A gain that brings the recording to `target_level` (rms), by `most_gain_db` at most.

    In decibels the gain nears what is wanted with the time constant `attack_s` where it falls and
    `release_s` where it rises (the branching smoother of Giannoulis, Massberg and Reiss, J. Audio
    Eng. Soc. 60, 2012). It begins at 0 dB. Raises InputError for times or a target not above 0.
    """

    attack_s: float = 0.005
    release_s: float = 0.3
    target_level: float = 0.05
    most_gain_db: float = 24.0

    def __post_init__(self) -> None:
        above_zero = min(self.attack_s, self.release_s, self.target_level) > 0
        if not (above_zero and 0 <= self.most_gain_db < np.inf):
            raise InputError(
                f"gain control: wanted times and a target above 0 and a gain from 0 dB, got "
                f"{self.attack_s} s, {self.release_s} s, {self.target_level} and "
                f"{self.most_gain_db} dB; correct them"
            )


def controlled(
    samples: F32, control: GainControl | None, rate_hz: int, clip_level: float = 1.0
) -> F32:
    """The recording (n) after its gain control, limited to `clip_level`; as it is without one."""
    if control is None:
        return samples
    steps = [
        1 - np.exp(-1 / (time_s * rate_hz))
        for time_s in (LEVEL_S, control.attack_s, control.release_s)
    ]
    target_db = 20 * np.log10(control.target_level)
    loud = _ride(samples.astype(np.float32), target_db, control.most_gain_db, *steps)
    return np.asarray(np.clip(loud, -clip_level, clip_level), dtype=np.float32)


@numba.njit(cache=True, fastmath=True, nogil=True)
def _ride(samples, target_db, most_gain_db, level, attack, release):  # type: ignore[no-untyped-def]
    """The samples, each times the gain of its moment."""
    out = np.empty_like(samples)
    power, gain_db = 0.0, 0.0
    for n in range(len(samples)):
        x = float(samples[n])
        power += level * (x * x - power)
        wanted_db = min(target_db - 10.0 * np.log10(power + SILENCE), most_gain_db)
        gain_db += (attack if wanted_db < gain_db else release) * (wanted_db - gain_db)
        out[n] = x * 10.0 ** (0.05 * gain_db)
    return out

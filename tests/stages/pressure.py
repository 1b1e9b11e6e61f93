"""Planted pressure curves: how high somebody is, what weather and wind add, and when they step."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import Barometer, Recording
from elfslam.stages.levels import SCALE_HEIGHT_M

Part = tuple[float, float, float]
"""For how long (s), how far up (m), and with how many footsteps a second."""


def walk_of(
    parts: Sequence[Part], *, seed: int = 100, wind_hpa: float = 0.02, rate_hz: float = 10.0
) -> tuple[Barometer, F64]:
    """The pressure along parts, as phones measure it, and the times of the footsteps.

    Wind is an Ornstein-Uhlenbeck process of 5 s.
    """
    generator = np.random.default_rng(seed)
    ends_s = np.cumsum([0.0, *(part[0] for part in parts)])
    heights_m = np.cumsum([0.0, *(part[1] for part in parts)])
    t_s = np.arange(0, ends_s[-1], 1 / rate_hz)
    height_m = np.interp(t_s, ends_s, heights_m)
    kept = np.exp(-1 / rate_hz / 5.0)
    gusts = generator.normal(size=len(t_s)) * wind_hpa * np.sqrt(1 - kept**2)
    wind = np.zeros(len(t_s))
    for k in range(1, len(t_s)):
        wind[k] = kept * wind[k - 1] + gusts[k]
    noise = generator.normal(size=len(t_s)) * 0.006
    pressure_hpa = 1013.0 * np.exp(-height_m / SCALE_HEIGHT_M) + wind + noise
    footsteps = [
        np.arange(begin_s, begin_s + lasting_s, 1 / cadence_hz)
        for begin_s, (lasting_s, _, cadence_hz) in zip(ends_s[:-1], parts, strict=True)
        if cadence_hz
    ]
    return Barometer(t_s, pressure_hpa), np.concatenate([*footsteps, np.zeros(0)])


STOREY_M = 3.5


def with_stairs(recording: Recording, begin_s: float, lasting_s: float) -> Recording:
    """The recording with a barometer that says that its walker went up a storey."""
    t_s = np.arange(0, recording.imu.t_s[-1], 0.1)
    height_m = STOREY_M * np.clip((t_s - begin_s) / lasting_s, 0, 1)
    noise = np.random.default_rng(100).normal(scale=0.006, size=len(t_s))
    pressure_hpa = 1013 * np.exp(-height_m / SCALE_HEIGHT_M) + noise
    return replace(recording, barometer=Barometer(t_s, pressure_hpa))

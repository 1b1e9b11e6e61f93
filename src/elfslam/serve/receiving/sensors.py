"""What the sensors of a recording read over time, in few enough numbers to be drawn.

A curve is cut into equal stretches of time, of each of which the least and the largest value are
kept, so that no peak is lost. All of it is parsed in a child of the server.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from elfslam.base.arrays import F32, F64
from elfslam.base.errors import ElfslamError, InputError
from elfslam.base.values import Audio, Imu, Recording
from elfslam.data.recordings import read_recording
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import EchoParameters, find_frames
from elfslam.stages.motion.level import level
from elfslam.stages.motion.parameters import MotionParameters


@dataclass(frozen=True)
class Curve:
    """Least and largest values in equal stretches of time; None where nothing was read."""

    name: str
    unit: str
    start_s: float
    step_s: float
    low: list[float | None]
    high: list[float | None]


@dataclass(frozen=True)
class SensorRate:
    """How often a sensor was read, and how often a second."""

    name: str
    readings: int
    rate_hz: float | None


@dataclass(frozen=True)
class Look:
    """All that is shown of a recording's sensors."""

    sensors: list[SensorRate]
    curves: list[Curve]
    chirps_played: int | None
    """Where that was noted."""
    chirps_heard_share: float | None
    """Of those that were due; None without sound."""


MOST_STRETCHES = 400
"""Of a curve; each is two numbers."""
LOUDNESS_S = 0.1
"""Sound is as loud as it is on average over a chirp period."""
SILENCE_DB = -120.0


def look_at(recording: Recording) -> Look:
    """The sensors of a recording and their curves."""
    played = recording.played_t_s
    return Look(
        list(_sensors(recording)),
        list(_curves(recording)),
        None if played is None else len(played),
        None if recording.audio is None else _heard_share(recording.audio, played),
    )


def _heard_share(audio: Audio, played_t_s: F64 | None) -> float:
    """Of how many chirps the direct arrival is found; none of sound in which nothing chirps."""
    parameters = EchoParameters(found_share=0.0, clipped_share=1.0)
    try:
        chirp = make_chirp(ChirpParameters(), audio.rate_hz)
        frames = find_frames(audio, chirp, parameters, played_t_s)
    except ElfslamError:
        return 0.0
    return round(float(np.mean(frames.found >= 0)), 3)


def _sensors(recording: Recording) -> Iterator[SensorRate]:
    if (audio := recording.audio) is not None:
        yield SensorRate("audio", audio.samples.shape[1], float(audio.rate_hz))
    for name in ("imu", "orientation", "odometry", "magnetometer", "barometer", "wifi", "emr"):
        value = getattr(recording, name)
        if value is not None and len(value.t_s):
            yield SensorRate(name, len(value.t_s), _rate_hz(value.t_s))


def _rate_hz(t_s: F64) -> float | None:
    """Readings a second, over all; None of a single one."""
    span_s = float(t_s[-1] - t_s[0])
    return round((len(t_s) - 1) / span_s, 3) if span_s > 0 else None


def _curves(recording: Recording) -> Iterator[Curve]:
    if (imu := recording.imu) is not None:
        strength = np.linalg.norm(imu.accel_mps2, axis=1)
        yield curve("acceleration", "m/s²", imu.t_s, strength)
        if (turning := _yaw_rate(imu)) is not None:
            yield curve("yaw rate", "°/s", *turning)
    if (field := recording.magnetometer) is not None and len(field.t_s):
        yield curve("magnetic field", "µT", field.t_s, np.linalg.norm(field.field_ut, axis=1))
    if (barometer := recording.barometer) is not None and len(barometer.t_s):
        yield curve("air pressure", "hPa", barometer.t_s, barometer.pressure_hpa)
    if (wifi := recording.wifi) is not None and len(wifi.t_s):
        seen = np.isfinite(wifi.rssi_dbm).sum(axis=1)
        yield curve("access points", "per scan", wifi.t_s, seen.astype(np.float64))
    if (audio := recording.audio) is not None and audio.samples.size:
        yield curve("sound level", "dB", *loudness(audio))


def _yaw_rate(imu: Imu) -> tuple[F64, F64] | None:
    """Times and turn rates about the vertical, degrees a second; None where that is not known."""
    try:
        levelled = level(imu, MotionParameters())
    except (InputError, ValueError):
        return None
    yaw_radps = np.sum(levelled.gyro_radps * levelled.up, axis=1)
    return (levelled.t_s, np.rad2deg(yaw_radps)) if np.isfinite(yaw_radps).all() else None


def loudness(audio: Audio) -> tuple[F64, F64]:
    """Times and levels of the loudest channel, decibels of full scale, per chirp period."""
    size = max(1, round(LOUDNESS_S * audio.rate_hz))
    sound = audio.samples
    starts = range(0, sound.shape[1], size)
    power = np.array([_mean_power(sound[:, first : first + size]) for first in starts])
    level_db = 10 * np.log10(np.maximum(power, 10 ** (SILENCE_DB / 10)))
    return (np.arange(len(power)) + 0.5) * size / audio.rate_hz, level_db


def _mean_power(samples: F32) -> float:
    return float(np.square(samples, dtype=np.float64).mean(axis=1).max())


def curve(name: str, unit: str, t_s: F64, values: F64) -> Curve:
    """The curve of values (n) at times (n) that increase, in at most `MOST_STRETCHES`."""
    stretches = min(MOST_STRETCHES, len(t_s))
    span_s = float(t_s[-1] - t_s[0])
    step_s = span_s / stretches if span_s > 0 else 1.0
    stretch = np.minimum(((t_s - t_s[0]) / step_s).astype(np.int64), stretches - 1)
    low, high = np.full((2, stretches), np.nan)
    np.fmin.at(low, stretch, values)
    np.fmax.at(high, stretch, values)
    return Curve(name, unit, round(float(t_s[0]), 6), step_s, _told(low), _told(high))


def _told(values: F64) -> list[float | None]:
    return [float(f"{value:.6g}") if np.isfinite(value) else None for value in values]


def parse(folder: str) -> dict[str, Any]:
    """What is told of a recording's folder. Raises InputError."""
    return asdict(look_at(read_recording(Path(folder))))

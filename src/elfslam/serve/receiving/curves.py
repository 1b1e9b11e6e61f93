"""What is shown of a recording's sensors: how often each was read, and curves that can be drawn."""

from __future__ import annotations

from dataclasses import dataclass


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

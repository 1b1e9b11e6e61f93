"""Mains hum: the field of power lines in the walls as the cord of an earphone picks it up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.base.parameters import parameter
from elfslam.base.values import Emr
from elfslam.world.imu import sample_times
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion

MICROTESLA_M_PER_A = 0.1
"""The magnetic constant over 4 pi."""
CABLE_RADIUS_M = 0.01


@dataclass(frozen=True, eq=False)
class PowerLine(Value):
    """A straight cable and what flows in it that does not come back beside it.

    `current_a` is the amplitude at the mains frequency and each of its multiples: what hangs on
    the line decides them (a heater has the first alone, a switching supply odd ones).
    """

    name: str
    from_m: F64 = array(3)
    to_m: F64 = array(3)
    current_a: F64 = array("h")


@dataclass(frozen=True)
class MainsParameters:
    """The grid, and the earphone that listens to it."""

    frequency_hz: float = parameter(50.0, "Hz", "mains frequency", low=10.0)
    rate_hz: float = parameter(4.0, "Hz", "vectors per second", low=0.1, high=50.0)
    loop_m2: float = parameter(0.05, "m2", "area between the earphone's cord and the body", low=0.0)
    noise_uv: float = parameter(0.05, "uV", "noise of every harmonic, real and imaginary", low=0.0)
    load_spread: float = parameter(0.1, "", "how far loads differ from day to day", low=0.0)


def line_field_ut(line: PowerLine, position_m: F64) -> F64:
    """The field (n, 3) of one ampere in the line, by Biot and Savart for a straight piece."""
    way = line.to_m - line.from_m
    along = way / np.linalg.norm(way)
    from_start, from_end = position_m - line.from_m, position_m - line.to_m
    aside = from_start - (from_start @ along)[:, None] * along
    square = np.maximum((aside**2).sum(axis=1), CABLE_RADIUS_M**2)
    ends = _cosine(from_start, along) - _cosine(from_end, along)
    return np.asarray(MICROTESLA_M_PER_A * np.cross(along, aside) * (ends / square)[:, None])


def listen_to_mains(
    motion: Motion,
    lines: Sequence[PowerLine],
    place_seed: int,
    generator: np.random.Generator,
    parameters: MainsParameters,
) -> Emr:
    """Amplitude (n, h) of every harmonic in microvolts, never negative.

    The cord hangs in the plane of walking, so that the horizontal field across it counts; its
    voltage grows with frequency. Phases of the loads belong to the place, noise to the walk.
    """
    t_s = sample_times(motion, parameters.rate_hz)
    at = np.round(t_s * KINEMATICS_RATE_HZ).astype(int)
    across = np.column_stack([-np.sin(motion.yaw_rad[at]), np.cos(motion.yaw_rad[at]), 0 * t_s])
    count = max(len(line.current_a) for line in lines)
    phases = np.random.default_rng([place_seed, 14]).uniform(0, 2 * np.pi, (len(lines), count))
    loads = np.exp(parameters.load_spread * generator.standard_normal(len(lines)))
    field_ut = np.zeros((len(t_s), count), dtype=complex)
    for line, load, phase in zip(lines, loads, phases, strict=True):
        flux = (line_field_ut(line, motion.position_m[at]) * across).sum(axis=1)
        current = load * np.pad(line.current_a, (0, count - len(line.current_a)))
        field_ut += flux[:, None] * current * np.exp(1j * phase)
    omega_radps = 2 * np.pi * parameters.frequency_hz * np.arange(1, count + 1)
    noise = generator.standard_normal((2, *field_ut.shape))
    noise_uv = parameters.noise_uv * (noise[0] + 1j * noise[1])
    return Emr(t_s, np.abs(parameters.loop_m2 * omega_radps * field_ut + noise_uv))


def _cosine(rows: F64, along: F64) -> F64:
    return np.asarray(rows @ along / np.maximum(np.linalg.norm(rows, axis=1), CABLE_RADIUS_M))

"""The magnetic fields of a place: the Earth's, bent by steel in walls, and that of mains cables."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.parameters import parameter
from elfslam.base.values import Emr, Magnetometer
from elfslam.world.imu import attitude, sample_times
from elfslam.world.room import Room
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion

MICROTESLA_M3_PER_AM2 = 0.1
"""The magnetic constant over 4 pi."""
BLOCK, PAIRS = 2000, 8_000_000
"""Positions at a time, and how many of them times dipoles, so that memory stays small."""
MOST_DIPOLES = 50_000


@dataclass(frozen=True)
class Magnetism:
    """What the `[magnetic]` table of a world says.

    `north_deg` is where magnetic north lies in the plane, counter-clockwise from x. Steel lies up
    to `depth_m` behind a surface, and no nearer than half of it; `moment_am2` is the standard
    deviation of its moment per axis.
    """

    strength_ut: float = 49.0
    inclination_deg: float = 47.0
    north_deg: float = 90.0
    dipoles_per_m2: float = 0.3
    moment_am2: float = 480.0
    depth_m: float = 3.0


@dataclass(frozen=True, eq=False)
class MagneticField(Value):
    """A uniform field and point dipoles; free of curl and divergence away from the dipoles."""

    earth_ut: F64 = array(3)
    dipole_m: F64 = array("d", 3)
    moment_am2: F64 = array("d", 3)


@dataclass(frozen=True)
class MagnetometerGrade:
    """Errors of a magnetometer, one standard deviation each, after the phone's calibration."""

    name: str
    rate_hz: float
    resolution_ut: float
    noise_ut: float
    hard_iron_ut: float


AK09911 = MagnetometerGrade(
    name="AKM AK09911", rate_hz=50.0, resolution_ut=0.6, noise_ut=0.75, hard_iron_ut=5.0
)
"""Data sheet MS1526-E-01: 0.6 uT per digit. It states no noise: 0.75 uT is what 50 Hz readings of
the mall phone, which has this part, scatter from one to the next; the hard iron that calibration
leaves makes the mean magnitude differ between walks there by about 5 uT."""


def magnetic_field(
    room: Room, magnetism: Magnetism, generator: np.random.Generator
) -> MagneticField:
    """The field of a room whose six surfaces hide dipoles drawn from `generator`."""
    dip, north = np.deg2rad(magnetism.inclination_deg), np.deg2rad(magnetism.north_deg)
    ahead = [np.cos(dip) * np.cos(north), np.cos(dip) * np.sin(north), -np.sin(dip)]
    dipole_m = _behind_surfaces(room.size_m, magnetism, generator)
    moment_am2 = magnetism.moment_am2 * generator.standard_normal(dipole_m.shape)
    return MagneticField(magnetism.strength_ut * np.array(ahead), dipole_m, moment_am2)


def field_at(field: MagneticField, position_m: F64) -> F64:
    """The field (n, 3) in microtesla and world axes at positions (n, 3)."""
    block = min(BLOCK, PAIRS // max(len(field.dipole_m), 1))
    rows = [
        field.earth_ut + _dipoles_at(field, position_m[first : first + block])
        for first in range(0, len(position_m), block)
    ]
    return np.vstack([np.zeros((0, 3)), *rows])


def read_magnetometer(
    motion: Motion, field: MagneticField, grade: MagnetometerGrade, generator: np.random.Generator
) -> Magnetometer:
    """What a magnetometer of the grade reads along a walk, in phone axes."""
    t_s = sample_times(motion, grade.rate_hz)
    at = np.round(t_s * KINEMATICS_RATE_HZ).astype(int)
    true_ut = attitude(motion)[at].inv().apply(field_at(field, motion.position_m[at]))
    hard_iron_ut = grade.hard_iron_ut * generator.standard_normal(3)
    noise_ut = grade.noise_ut * generator.standard_normal(true_ut.shape)
    digits = np.round((true_ut + hard_iron_ut + noise_ut) / grade.resolution_ut)
    return Magnetometer(t_s, digits * grade.resolution_ut)


def _behind_surfaces(size_m: F64, magnetism: Magnetism, generator: np.random.Generator) -> F64:
    """Points behind the surfaces x=0, x=L, y=0, y=W, floor and ceiling, evenly by area."""
    length, width, height = size_m
    areas = np.repeat([width * height, length * height, length * width], 2)
    count = round(float(areas.sum()) * magnetism.dipoles_per_m2)
    if count > MOST_DIPOLES:
        raise InputError(
            f"magnetic: {count} dipoles behind the surfaces of the room, wanted {MOST_DIPOLES} at "
            "most; lower dipoles_per_m2"
        )
    surface = generator.choice(6, size=count, p=areas / areas.sum())
    points = generator.uniform(0, 1, (count, 3)) * size_m
    depth_m = magnetism.depth_m * generator.uniform(0.5, 1, count)
    axis, far = surface // 2, surface % 2 == 1
    points[np.arange(count), axis] = np.where(far, size_m[axis] + depth_m, -depth_m)
    return np.asarray(points)


def _dipoles_at(field: MagneticField, position_m: F64) -> F64:
    """Sum over dipoles of 3 (m r) r / |r|^5 - m / |r|^3, times the constant."""
    away = position_m[:, None, :] - field.dipole_m
    square = (away**2).sum(axis=2)
    along = 3 * np.einsum("ndk,dk->nd", away, field.moment_am2) / square**2.5
    sums = np.einsum("nd,ndk->nk", along, away) - square**-1.5 @ field.moment_am2
    return np.asarray(MICROTESLA_M3_PER_AM2 * sums)


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

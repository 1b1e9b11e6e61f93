"""The magnetic field of a place: the Earth's, bent by steel in walls, floor and ceiling."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.values import Magnetometer
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

"""Magnetic heading of a whole walk: the mean field, carried by the gyroscope.

Buildings bend the field, so its direction at one place says little; the gyroscope turns the
readings of a whole walk into one frame, where they are averaged. The phone's own field (hard iron)
turns with the phone and so shows in any walk that turns. It stays from walk to walk and jumps
now and then, so what one walk learnt of it is handed to the next.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elfslam.base.arrays import C128, F64, Value, array
from elfslam.base.errors import InputError
from elfslam.base.geometry import wrap_angle
from elfslam.base.values import Imu, Magnetometer
from elfslam.stages.motion.level import Level, averaged, levelled_pieces
from elfslam.stages.motion.parameters import MotionParameters
from elfslam.stages.motion.reckoning import footfalls, lengths_between, phone_turn, smooth_heading

ROUNDS = 20
"""The scale of the hard iron and its value are found in turn."""
TAIL = 3.0
"""Degrees of freedom of Student's t, the prior of the hard iron: mostly near, at times far off."""
AGREES, DISAGREES = 0.95, 0.9
"""Length of the mean direction of the field. Of 89 real walks in a mall 95 % have 0.98 or more."""
FEWEST_FOOTSTEPS = 40
CANDIDATES = 256
"""Footsteps of a walk at which a half turn is tried, before those around the best one."""
HALF_TURN_S = 1.0


@dataclass(frozen=True, eq=False)
class HardIron(Value):
    """The phone's own field, levelled: forward (up the screen) and left, and its sigma per axis."""

    forward_left_ut: F64 = array(2)
    sigma_ut: float = 0.0


@dataclass(frozen=True, eq=False)
class Compass(Value):
    """Heading of the phone at the first footstep, counter-clockwise from magnetic east.

    It is the heading to start `dead_reckon` with, in a plane whose y points to magnetic north.
    """

    heading_rad: float
    sigma_rad: float
    hard_iron: HardIron


def compass_heading(
    imu: Imu,
    magnetometer: Magnetometer,
    parameters: MotionParameters,
    known: HardIron | None = None,
) -> Compass:
    """The heading of a walk from its magnetometer; the top of the phone points where one walks.

    `known` is the hard iron as the phone's walk before left it. Raises InputError as
    `dead_reckon` does, where there are fewer than two footsteps, or no field.
    """
    pieces = levelled_pieces(imu, parameters)
    found = [(piece, footfalls(piece, parameters)) for piece in pieces]
    # What lies behind an interruption does not tell how the walk began.
    levelled, footsteps_t_s = next((each for each in found if len(each[1]) > 1), found[0])
    if len(footsteps_t_s) < 2:
        raise InputError("compass: found no two footsteps, wanted a walk; record a longer one")
    lengths_m = lengths_between(levelled, footsteps_t_s, parameters)
    halfway_s = (footsteps_t_s[1:] + footsteps_t_s[:-1]) / 2
    field_ut, turned = _carried(levelled, magnetometer, halfway_s)
    prior = known or HardIron(np.zeros(2), parameters.hard_iron_sigma_ut)
    iron, north_ut, sigma_ut = _separated(field_ut, turned, lengths_m, prior, parameters)
    if abs(north_ut) < 1e-6:
        raise InputError("compass: the field has no horizontal part; check the magnetometer")
    first_rad = np.interp(footsteps_t_s[0], levelled.t_s, smooth_heading(levelled, parameters))
    heading_rad = float(wrap_angle(np.pi / 2 - np.angle(north_ut) + first_rad))
    return Compass(heading_rad, sigma_ut / abs(north_ut), iron)


def missed_half_turn(
    imu: Imu, magnetometer: Magnetometer, parameters: MotionParameters
) -> float | None:
    """When (s) the gyroscope missed a half turn, where the field agrees with itself with one alone.

    None where it agrees as it is, or in no way. Where motion is interrupted, the longest stretch
    is looked at. Raises InputError as `check_imu` does.
    """
    levelled = max(levelled_pieces(imu, parameters), key=lambda piece: len(piece.t_s))
    footsteps_t_s = footfalls(levelled, parameters)
    if len(footsteps_t_s) < FEWEST_FOOTSTEPS:
        return None
    lengths_m = lengths_between(levelled, footsteps_t_s, parameters)
    halfway_s = (footsteps_t_s[1:] + footsteps_t_s[:-1]) / 2
    field_ut, turned = _carried(levelled, magnetometer, halfway_s)
    agreement = partial(_agreement, field_ut, turned, lengths_m, parameters)
    steps = len(halfway_s)
    if agreement(steps) > DISAGREES:
        return None
    apart = -(-steps // CANDIDATES)
    near = max(range(apart, steps, apart), key=agreement)
    first = max(range(near - apart + 1, min(near + apart, steps)), key=agreement)
    return float(footsteps_t_s[first]) if agreement(first) >= AGREES else None


def _agreement(
    field_ut: C128, turned: C128, lengths_m: F64, parameters: MotionParameters, first: int
) -> float:
    """Length of the mean direction of the field less hard iron, turned from step `first` on."""
    sign = np.where(np.arange(len(field_ut)) < first, 1.0, -1.0)
    unknown = HardIron(np.zeros(2), parameters.hard_iron_sigma_ut)
    found = _separated(field_ut * sign, turned * sign, lengths_m, unknown, parameters)[0]
    rest = field_ut * sign - turned * sign * complex(*found.forward_left_ut)
    weight = lengths_m / lengths_m.sum()
    return float(abs((weight * rest / np.maximum(abs(rest), 1e-9)).sum()))


def half_turned(imu: Imu, at_s: float) -> Imu:
    """The sensors with a half turn about the vertical put into the gyroscope, a second long."""
    rows = abs(imu.t_s - at_s) <= HALF_TURN_S / 2
    up = imu.accel_mps2[rows].mean(axis=0)
    gyro_radps = imu.gyro_radps.copy()
    gyro_radps[rows] += np.pi / np.gradient(imu.t_s)[rows].sum() * up / np.linalg.norm(up)
    return replace(imu, gyro_radps=gyro_radps)


def _carried(levelled: Level, magnetometer: Magnetometer, at_s: F64) -> tuple[C128, C128]:
    """The horizontal field in the frame of the first sample, and how far the phone has turned.

    Both as complex numbers (n): forward is 1, left is i.
    """
    up = levelled.up
    ahead = np.array([0.0, 1.0, 0.0]) - up * up[:, 1:2]
    ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-9)
    left = np.cross(up, ahead)
    field_ut = np.column_stack(
        [np.interp(levelled.t_s, magnetometer.t_s, axis) for axis in magnetometer.field_ut.T]
    )
    turn = np.exp(1j * phone_turn(levelled))
    seen = ((field_ut * ahead).sum(axis=1) + 1j * (field_ut * left).sum(axis=1)) * turn
    usual_s = float(np.median(np.diff(at_s))) if len(at_s) > 1 else 0.5
    smooth = averaged(np.column_stack([seen.real, seen.imag]), usual_s, levelled.rate_hz)
    return (
        _complex_at(at_s, levelled.t_s, smooth[:, 0] + 1j * smooth[:, 1]),
        _complex_at(at_s, levelled.t_s, turn),
    )


def _complex_at(at_s: F64, t_s: F64, values: C128) -> C128:
    return np.interp(at_s, t_s, values.real) + 1j * np.interp(at_s, t_s, values.imag)


def _separated(
    field_ut: C128, turned: C128, lengths_m: F64, prior: HardIron, parameters: MotionParameters
) -> tuple[HardIron, complex, float]:
    """Hard iron, the building's field in the first frame, and the sigma of that per axis.

    Least squares of field = north + turned * iron, weighted by length, with a Student prior.
    """
    weight = lengths_m / lengths_m.sum()
    independent = max(1.0, float(lengths_m.sum()) / parameters.field_correlation_m)
    noise_ut2 = parameters.field_sigma_ut**2 / independent
    before = complex(*prior.forward_left_ut)
    from_mean = turned - (weight * turned).sum()
    told = float((weight * abs(from_mean) ** 2).sum())
    pull = (weight * from_mean.conj() * (field_ut - (weight * field_ut).sum())).sum()
    variance_ut2, iron = prior.sigma_ut**2, before
    for _ in range(ROUNDS):
        trust = noise_ut2 / variance_ut2
        iron = (pull + trust * before) / (told + trust)
        wide_ut2 = (TAIL * prior.sigma_ut**2 + abs(iron - before) ** 2) / (TAIL + 2)
        variance_ut2 = max(prior.sigma_ut**2, wide_ut2)
    left_ut = float(np.sqrt(1 / (told / noise_ut2 + 1 / variance_ut2)))
    drifted_ut = float(np.hypot(left_ut, parameters.hard_iron_drift_ut))
    sigma_ut = min(drifted_ut, max(prior.sigma_ut, parameters.hard_iron_sigma_ut))
    rest = field_ut - turned * iron
    # The mean of directions: a strong field nearby does not outvote the rest of the walk.
    north = (weight * rest / np.maximum(abs(rest), 1e-9)).sum() * float(np.median(abs(rest)))
    spread_ut = float(np.sqrt(noise_ut2 + left_ut**2 * abs((weight * turned).sum()) ** 2))
    return HardIron(np.array([iron.real, iron.imag]), sigma_ut), complex(north), spread_ut

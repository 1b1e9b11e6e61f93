"""Levelling: inertial readings on an even clock, with the direction that points up.

Where the sensors were interrupted they are levelled piece by piece."""

from dataclasses import dataclass

import numpy as np
from scipy import ndimage, signal
from scipy.spatial.transform import Rotation

from elfslam.base.arrays import F64, Bool, Value, array
from elfslam.base.errors import InputError
from elfslam.base.values import Imu
from elfslam.stages.motion.parameters import MotionParameters

GRAVITY_MPS2 = 9.81
OFFSET_WINDOW_S = 1.0
"""A stride: its mean acceleration is gravity."""


@dataclass(frozen=True, eq=False)
class Level(Value):
    """Sensors at an even rate; the gyroscope without its bias, `up` a unit vector in phone axes."""

    t_s: F64 = array("n", increasing=True)
    accel_mps2: F64 = array("n", 3)
    gyro_radps: F64 = array("n", 3)
    up: F64 = array("n", 3, unit_rows=True)
    rate_hz: float = 0.0


@dataclass(frozen=True, eq=False)
class Rest(Value):
    """Rates of turn (3), rad/s in phone axes, summed over so many readings at rest."""

    sum_radps: F64 = array(3)
    count: int = 0


NO_REST = Rest(np.zeros(3))


def level(imu: Imu, parameters: MotionParameters, rest: Rest = NO_REST) -> Level:
    """The sensors evenly sampled at their own rate, with what points up at each time.

    `rest` is what the phone's gyroscope read at rest before these rows.
    """
    t_s, accel, gyro = evenly_sampled(imu)
    rate_hz = rate_of(t_s)
    turn_radps = gyro - still_bias(accel, gyro, rate_hz, parameters, rest)
    up = _up_in_phone(accel, turn_radps, rate_hz, parameters)
    return Level(t_s, accel, turn_radps, up, rate_hz)


def rate_of(t_s: F64) -> float:
    """The usual rate, Hz, of samples at these times."""
    return float(1.0 / np.median(np.diff(t_s)))


def averaged(values: F64, window_s: float, rate_hz: float) -> F64:
    """Running mean over a window, along the first axis."""
    size = max(1, round(window_s * rate_hz))
    return np.asarray(ndimage.uniform_filter1d(values, size, axis=0, mode="nearest"))


def evenly_sampled(imu: Imu) -> tuple[F64, F64, F64]:
    """Times, acceleration and rate of turn on an even grid at the recording's own rate."""
    rate_hz = rate_of(imu.t_s)
    count = int((imu.t_s[-1] - imu.t_s[0]) * rate_hz) + 1
    t_s = imu.t_s[0] + np.arange(count) / rate_hz
    accel, gyro = (
        np.column_stack([np.interp(t_s, imu.t_s, column) for column in rows.T])
        for rows in (imu.accel_mps2, imu.gyro_radps)
    )
    return t_s, accel, gyro


def still_bias(
    accel: F64, gyro: F64, rate_hz: float, parameters: MotionParameters, rest: Rest = NO_REST
) -> F64:
    """Mean rate of turn (3) while lying still, then or before; zero where it never rests."""
    still = still_rows(accel, gyro, rate_hz, parameters)
    count = rest.count + int(still.sum())
    return np.asarray((rest.sum_radps + gyro[still].sum(axis=0)) / max(count, 1))


def check_imu(imu: Imu, parameters: MotionParameters) -> None:
    """Raises InputError where the recording is too short or sampled too slowly."""
    duration_s = float(imu.t_s[-1] - imu.t_s[0]) if len(imu.t_s) > 1 else 0.0
    if duration_s < parameters.least_duration_s:
        raise InputError(
            f"inertial data: got {duration_s:.1f} s, wanted at least "
            f"{parameters.least_duration_s:g} s; record longer"
        )
    if rate_of(imu.t_s) < parameters.least_rate_hz:
        raise InputError(
            f"inertial data: got {rate_of(imu.t_s):.1f} samples/s, wanted at least "
            f"{parameters.least_rate_hz:g}; choose a faster sensor rate"
        )


def check_gyroscope(levelled: Level, parameters: MotionParameters) -> None:
    """Raises InputError where the rate of turn is no walker's, or none that gravity bears out."""
    offset_radps = float(np.linalg.norm(offset_by_gravity(levelled)))
    if offset_radps > parameters.most_offset_radps:
        raise InputError(
            f"gyroscope: turns by {offset_radps:.2g} rad/s more than gravity does in the phone, "
            f"wanted at most {parameters.most_offset_radps:g}; calibrate it, and check that it is "
            "in rad/s and has the accelerometer's axes"
        )
    yaw_radps = float(np.mean(np.sum(levelled.gyro_radps * levelled.up, axis=1)))
    duration_s = len(levelled.t_s) / levelled.rate_hz
    if abs(yaw_radps) > parameters.most_turning_radps + 2 * np.pi / duration_s:
        raise InputError(
            f"gyroscope: turns by {yaw_radps:.2g} rad/s about the vertical all along, wanted at "
            f"most {parameters.most_turning_radps:g} of a walk; calibrate it, and check that it is "
            "in rad/s"
        )


def offset_by_gravity(levelled: Level) -> F64:
    """The gyroscope's offset (3), rad/s, as far as gravity contradicts it: not about the vertical.

    In the phone the direction g of gravity obeys dg/dt = -turn x g; what an offset adds to the
    turn is left over: offset x g, and g x (offset x g) is the offset without its part along g. The
    median is of that alone: who turns sharply also pushes the phone aside.
    """
    seen = averaged(levelled.accel_mps2, OFFSET_WINDOW_S, levelled.rate_hz)
    g = seen / np.maximum(np.linalg.norm(seen, axis=1, keepdims=True), 1e-9)
    turn_radps = averaged(levelled.gyro_radps, OFFSET_WINDOW_S, levelled.rate_hz)
    left_over = np.gradient(g, 1 / levelled.rate_hz, axis=0) + np.cross(turn_radps, g)
    return np.asarray(np.median(np.cross(g, left_over), axis=0))


def is_enough(t_s: F64, parameters: MotionParameters) -> bool:
    """Whether readings at these times are long and quick enough to find footsteps in."""
    if len(t_s) < 2 or t_s[-1] - t_s[0] < parameters.least_duration_s:
        return False
    return rate_of(t_s) >= parameters.least_rate_hz


def _up_in_phone(accel: F64, gyro: F64, rate_hz: float, parameters: MotionParameters) -> F64:
    """Unit vectors (n, 3) that point up, in phone axes.

    The gyroscope carries the phone into a frame that barely moves, where a slow low-pass without
    delay leaves of the acceleration only gravity, however the phone is turned meanwhile.
    """
    mean_radps = (gyro[1:] + gyro[:-1]) / 2
    fixed_from_phone = _cumulated(
        Rotation.from_rotvec(np.vstack([np.zeros(3), mean_radps / rate_hz]))
    )
    sos = signal.butter(1, parameters.gravity_cutoff_hz, fs=rate_hz, output="sos")
    padding = min(len(accel) - 1, round(rate_hz / parameters.gravity_cutoff_hz))
    gravity = signal.sosfiltfilt(
        sos, fixed_from_phone.apply(accel), axis=0, padtype="even", padlen=padding
    )
    in_phone = fixed_from_phone.inv().apply(gravity)
    return np.asarray(in_phone / np.linalg.norm(in_phone, axis=1, keepdims=True))


def _cumulated(turns: Rotation) -> Rotation:
    """Products of the first k rotations, for every k, by doubling."""
    reach = 1
    while reach < len(turns):
        turns = Rotation.concatenate([turns[:reach], turns[:-reach] * turns[reach:]])
        reach *= 2
    return turns


def still_rows(accel: F64, gyro: F64, rate_hz: float, parameters: MotionParameters) -> Bool:
    """Rows inside stretches where the phone hardly shakes or turns for long enough.

    A phone in a hand turns slowly for as long as it is held, which is no bias: its tremor tells.
    """
    window = max(1, round(parameters.still_s * rate_hz))
    shake, tremor = (
        np.linalg.norm(rows - ndimage.uniform_filter1d(rows, window, axis=0), axis=1)
        for rows in (accel, gyro)
    )
    calm = (
        (shake < parameters.still_accel_mps2)
        & (tremor < parameters.still_tremor_radps)
        & (np.linalg.norm(gyro, axis=1) < parameters.still_gyro_radps)
    )
    return np.asarray(ndimage.binary_opening(calm, np.ones(window, bool)))


MOST_TURN_SIGMA_RAD = np.pi / 2
"""Beyond a quarter turn a heading says nothing any more."""


def levelled_pieces(imu: Imu, parameters: MotionParameters) -> list[Level]:
    """The sensors levelled, a piece from one interruption of `longest_gap_s` to the next.

    Pieces too short to find footsteps in are left out; what the gyroscope read at rest in one
    holds in all. Raises InputError as `check_imu` does, or where no piece is long enough.
    """
    check_imu(imu, parameters)
    pieces = _pieces(imu, parameters)
    if not pieces:
        raise InputError(
            f"inertial data: no {parameters.least_duration_s:g} s without an interruption of more "
            f"than {parameters.longest_gap_s:g} s; record again, or raise motion.longest_gap_s"
        )
    if len(pieces) == 1:
        return [level(pieces[0], parameters)]
    rests = [_rest_of(piece, parameters) for piece in pieces]
    return [level(piece, parameters, _of_others(rests, k)) for k, piece in enumerate(pieces)]


def bridge(unseen_s: float, parameters: MotionParameters) -> tuple[F64, F64]:
    """Move and sigma (3 each) over seconds in which nothing was measured.

    Somewhere between standing still and walking on, and whoever walked may have turned.
    """
    halfway_m = parameters.unseen_speed_mps * unseen_s / 2
    turn_rad = min(parameters.unseen_turn_radps * unseen_s, MOST_TURN_SIGMA_RAD)
    return np.array([halfway_m, 0.0, 0.0]), np.array([halfway_m, halfway_m, turn_rad])


def _pieces(imu: Imu, parameters: MotionParameters) -> list[Imu]:
    begins = np.flatnonzero(np.diff(imu.t_s) > parameters.longest_gap_s) + 1
    if not len(begins):
        return [imu]
    columns = (np.split(rows, begins) for rows in (imu.t_s, imu.accel_mps2, imu.gyro_radps))
    rows = zip(*columns, strict=True)
    return [Imu(*piece) for piece in rows if is_enough(piece[0], parameters)]


def _rest_of(imu: Imu, parameters: MotionParameters) -> Rest:
    t_s, accel, gyro = evenly_sampled(imu)
    still = still_rows(accel, gyro, rate_of(t_s), parameters)
    return Rest(gyro[still].sum(axis=0), int(still.sum()))


def _of_others(rests: list[Rest], but: int) -> Rest:
    others = [rest for k, rest in enumerate(rests) if k != but]
    total_radps = np.sum([rest.sum_radps for rest in others], axis=0)
    return Rest(total_radps, sum(rest.count for rest in others))

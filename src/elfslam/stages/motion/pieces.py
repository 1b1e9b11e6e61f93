"""Inertial sensors with interruptions: levelled piece by piece, and what lies between pieces."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.values import Imu
from elfslam.stages.motion.level import (
    Level,
    Rest,
    check_imu,
    evenly_sampled,
    is_enough,
    level,
    rate_of,
    still_rows,
)
from elfslam.stages.motion.parameters import MotionParameters

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

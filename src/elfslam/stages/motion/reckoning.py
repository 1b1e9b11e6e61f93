"""Integration of steps and heading: a pose per footstep."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.geometry import chain, compose
from elfslam.base.values import Imu, Odometry
from elfslam.stages.motion.footsteps import footfalls
from elfslam.stages.motion.heading import smooth_heading, turned_since_rest
from elfslam.stages.motion.lengths import lengths_between
from elfslam.stages.motion.level import Level, check_gyroscope
from elfslam.stages.motion.parameters import MotionParameters, check_motion
from elfslam.stages.motion.pieces import bridge, levelled_pieces

ORIGIN = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Footsteps (n) without an interruption, lengths (n-1) and moves (n-1, 3) between them."""

    levelled: Level
    footsteps_t_s: F64
    lengths_m: F64
    moves: F64


def dead_reckon(
    imu: Imu, parameters: MotionParameters, start_pose: tuple[float, float, float] | None = None
) -> Odometry:
    """One node per footstep, with the sigma of each move.

    `start_pose` (or the origin) is where the walker stood, and faced, as the recording began;
    where the phone did not rest then, the first footstep is there. Over an interruption of the
    sensors the way is unknown: the sigma of that move says so.

    Raises InputError where the recording is too short, too slow, in pieces too short, holds too
    few footsteps or a gyroscope that cannot be right, ParameterError where two parameters
    contradict each other.
    """
    check_motion(parameters)
    pieces = levelled_pieces(imu, parameters)
    for each in pieces:
        check_gyroscope(each, parameters)
    found = [(each, footfalls(each, parameters)) for each in pieces]
    walked = [_stretch(*each, parameters) for each in found if len(each[1]) > 1]
    _check_enough(sum(len(each.footsteps_t_s) for each in walked), parameters)
    begin, begin_s = walked[0], float(walked[0].footsteps_t_s[0])
    turned_rad = turned_since_rest(begin.levelled, begin_s, parameters)
    first = _first_pose(start_pose or ORIGIN, turned_rad, float(begin.lengths_m[0]))
    moves, sigma = _joined(walked, parameters)
    return Odometry(
        np.concatenate([each.footsteps_t_s for each in walked]),
        chain(first, moves),
        sigma,
        parameters.step_scale_sigma,
        parameters.heading_drift_sigma_radps,
    )


def _check_enough(footsteps: int, parameters: MotionParameters) -> None:
    if footsteps < parameters.least_footsteps:
        raise InputError(
            f"inertial data: found {footsteps} footsteps, wanted at least "
            f"{parameters.least_footsteps}; record a longer walk, phone in the hand"
        )


def _stretch(levelled: Level, footsteps_t_s: F64, parameters: MotionParameters) -> _Stretch:
    lengths_m = lengths_between(levelled, footsteps_t_s, parameters)
    heading_rad = smooth_heading(levelled, parameters)
    at_footsteps = np.interp(footsteps_t_s, levelled.t_s, heading_rad)
    halfway_s = (footsteps_t_s[1:] + footsteps_t_s[:-1]) / 2
    halfway = np.interp(halfway_s, levelled.t_s, heading_rad)
    moves = moves_between(lengths_m, at_footsteps, halfway)
    return _Stretch(levelled, footsteps_t_s, lengths_m, moves)


def _joined(walked: Sequence[_Stretch], parameters: MotionParameters) -> tuple[F64, F64]:
    """Moves and sigmas (n-1, 3) of all footsteps, with a bridge between two stretches."""
    moves = np.concatenate([each.moves for each in walked])
    sigma = step_sigma(np.concatenate([each.lengths_m for each in walked]), parameters)
    ends = np.cumsum([len(each.moves) for each in walked])[:-1]
    for end, (before, after) in reversed(list(zip(ends, pairwise(walked), strict=True))):
        unseen_s = float(after.footsteps_t_s[0] - before.footsteps_t_s[-1])
        move, move_sigma = bridge(unseen_s, parameters)
        moves = np.insert(moves, end, move, axis=0)
        sigma = np.insert(sigma, end, move_sigma, axis=0)
    return moves, sigma


def nodes_by_distance(odometry: Odometry, spacing_m: float) -> Odometry:
    """The odometry thinned to a node each time the walker is `spacing_m` from the node before.

    For devices that bring their own odometry at a fixed rate. The variances of the moves between
    two nodes add up. Raises InputError where the walk is shorter than the spacing.
    """
    kept = _spaced_rows(odometry.world_from_body[:, :2], spacing_m)
    if len(kept) < 2:
        raise InputError(
            f"odometry: the walk never gets {spacing_m:g} m away from its start; "
            "choose a smaller spacing"
        )
    summed = np.vstack([np.zeros(3), np.cumsum(odometry.step_sigma**2, axis=0)])
    sigma = np.sqrt(np.diff(summed[kept], axis=0))
    return replace(
        odometry,
        t_s=odometry.t_s[kept],
        world_from_body=odometry.world_from_body[kept],
        step_sigma=sigma,
    )


def moves_between(lengths_m: F64, heading_rad: F64, halfway_rad: F64) -> F64:
    """Moves (n-1, 3) between footsteps: each goes where the walker heads halfway through it."""
    aside = halfway_rad - heading_rad[:-1]
    return np.column_stack(
        [lengths_m * np.cos(aside), lengths_m * np.sin(aside), np.diff(heading_rad)]
    )


def _first_pose(
    start_pose: tuple[float, float, float], turned_rad: float | None, length_m: float
) -> F64:
    """Pose (3) of the first footstep: half a step from where the walker stood."""
    start = np.asarray(start_pose)
    if turned_rad is None:
        return start
    ahead = length_m / 2 * np.array([np.cos(turned_rad / 2), np.sin(turned_rad / 2)])
    return compose(start, np.array([*ahead, turned_rad]))


def step_sigma(lengths_m: F64, parameters: MotionParameters) -> F64:
    """Sigma (n-1, 3) of the moves; the first step of a walk may point aside."""
    heading_rad = np.full(len(lengths_m), parameters.heading_sigma_rad)
    heading_rad[0] = np.hypot(heading_rad[0], parameters.setting_off_sigma_rad)
    return np.column_stack(
        [parameters.forward_sigma * lengths_m, parameters.lateral_sigma * lengths_m, heading_rad]
    )


def _spaced_rows(xy_m: F64, spacing_m: float) -> I64:
    """Rows at least `spacing_m` from the row kept before, straight: standing adds none."""
    kept = [0]
    for row, position in enumerate(xy_m):
        if np.hypot(*(position - xy_m[kept[-1]])) >= spacing_m - 1e-9:
            kept.append(row)
    return np.asarray(kept, np.int64)

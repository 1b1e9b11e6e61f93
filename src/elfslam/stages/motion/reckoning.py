"""Pedestrian dead reckoning: step detection, step lengths, headings, and a pose for each."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import ndimage, signal

from elfslam.base.arrays import F64, I64
from elfslam.base.errors import InputError
from elfslam.base.geometry import chain, compose
from elfslam.base.values import Imu, Odometry
from elfslam.stages.motion.level import (
    GRAVITY_MPS2,
    Level,
    averaged,
    bridge,
    check_gyroscope,
    levelled_pieces,
)
from elfslam.stages.motion.parameters import MotionParameters, check_motion


def find_footsteps(imu: Imu, parameters: MotionParameters) -> F64:
    """Times (n) of the footfalls, s: peaks of the vertical acceleration in the footstep band.

    Raises InputError as `levelled_pieces` does; a walk without footsteps gives no times.
    """
    pieces = levelled_pieces(imu, parameters)
    return np.concatenate([footfalls(piece, parameters) for piece in pieces])


def footfalls(levelled: Level, parameters: MotionParameters) -> F64:
    """Times (n) of the footfalls, s, of levelled sensors."""
    t_s, rate_hz = levelled.t_s, levelled.rate_hz
    bounce = vertical_bounce(levelled, parameters)
    span = 2 * np.sqrt(2) * bounce_rms(bounce, parameters.bounce_window_s, rate_hz)
    wanted = np.maximum(parameters.least_bounce_mps2, parameters.relative_bounce * span)
    peaks, found = signal.find_peaks(
        bounce,
        distance=max(1, round(parameters.least_interval_s * rate_hz)),
        prominence=parameters.least_bounce_mps2,
    )
    kept = peaks[found["prominences"] >= wanted[peaks]]
    return np.asarray(t_s[kept] + _peak_offset(bounce, kept) / rate_hz)


def vertical_bounce(levelled: Level, parameters: MotionParameters) -> F64:
    """The vertical acceleration (n) in the footstep band, m/s2."""
    vertical = np.sum(levelled.accel_mps2 * levelled.up, axis=1) - GRAVITY_MPS2
    band = (parameters.cadence_low_hz, parameters.cadence_high_hz)
    sos = signal.butter(2, band, "bandpass", fs=levelled.rate_hz, output="sos")
    return np.asarray(signal.sosfiltfilt(sos, vertical))


def bounce_rms(bounce: F64, window_s: float, rate_hz: float) -> F64:
    """Root mean square (n) of the bounce over a window; that of a sinusoid spans 2.8 times it."""
    return np.asarray(np.sqrt(np.maximum(averaged(bounce**2, window_s, rate_hz), 0.0)))


def _peak_offset(signal_rows: F64, peaks: I64) -> F64:
    """Where the parabola through a peak and its neighbours is highest, in samples from it."""
    before, at, after = (signal_rows[peaks + shift] for shift in (-1, 0, 1))
    return np.asarray((before - after) / np.minimum(2 * (before - 2 * at + after), -1e-12))


SETTING_OFF_S, REST_S = 0.6, 0.5
"""Before the first footfall a foot is lifted; before that, a phone may be at rest."""


def smooth_heading(levelled: Level, parameters: MotionParameters) -> F64:
    """Heading (n), rad, averaged over a stride, which takes the sway of the body out."""
    return averaged(phone_turn(levelled), parameters.heading_window_s, levelled.rate_hz)


def turned_since_rest(
    levelled: Level, footstep_s: float, parameters: MotionParameters
) -> float | None:
    """How far (rad) the walker has turned by the first footstep since the recording began.

    None where the phone was not at rest for the first half second. Whoever sets off softly has
    gone a step or two, and may have turned, by the first footstep that is found.
    """
    rest = round(REST_S * levelled.rate_hz)
    if (levelled.t_s < footstep_s - SETTING_OFF_S).sum() < rest:
        return None
    if np.abs(vertical_bounce(levelled, parameters)[:rest]).max() > parameters.least_bounce_mps2:
        return None
    facing_rad = phone_turn(levelled)[:rest].mean()
    heading_rad = np.interp(footstep_s, levelled.t_s, smooth_heading(levelled, parameters))
    return float(heading_rad - facing_rad)


def phone_turn(levelled: Level) -> F64:
    """How far (n), rad, the phone has turned about the vertical since the first sample."""
    yaw_radps = np.sum(levelled.gyro_radps * levelled.up, axis=1)
    steps_rad = (yaw_radps[1:] + yaw_radps[:-1]) / 2 / levelled.rate_hz
    return np.concatenate([[0.0], np.cumsum(steps_rad)])


STEPS_AROUND = 5
"""The usual interval is the median of so many: one pause or missed footstep does not move it."""


def lengths_between(levelled: Level, footsteps_t_s: F64, parameters: MotionParameters) -> F64:
    """Lengths (n-1), m, of the steps between n footsteps.

    A power law in the bounce, the rms of the vertical acceleration in the footstep band around
    the step, and in the cadence: half way between the bounce alone (Weinberg 2002) and the
    height of the bounce (the inverted pendulum of Zijlstra and Hof 2003: powers 0.5 and -1).
    It is joined with the walk ratio of a population as `_with_walk_ratio` says.
    A pause is no long step.
    """
    bounce = vertical_bounce(levelled, parameters)
    rms = bounce_rms(bounce, parameters.length_window_s, levelled.rate_hz)
    halfway_s = (footsteps_t_s[1:] + footsteps_t_s[:-1]) / 2
    intervals_s = np.diff(footsteps_t_s)
    usual_s = ndimage.median_filter(intervals_s, STEPS_AROUND, mode="nearest")
    # A cadence out of the band is that of someone who stops and goes.
    cadence_hz = np.clip(1 / usual_s, parameters.cadence_low_hz, parameters.cadence_high_hz)
    by_bounce_m = (
        parameters.step_length_m
        * (np.interp(halfway_s, levelled.t_s, rms) / parameters.typical_bounce_mps2)
        ** parameters.length_power_of_bounce
        * (cadence_hz / parameters.typical_cadence_hz) ** parameters.length_power_of_cadence
    )
    lengths_m = _with_walk_ratio(by_bounce_m, cadence_hz, parameters)
    lengths_m = np.clip(lengths_m, parameters.shortest_step_m, parameters.longest_step_m)
    paused = intervals_s > parameters.pause_intervals * usual_s
    return parameters.step_scale * np.where(paused, parameters.pause_length_m, lengths_m)


def _with_walk_ratio(by_bounce_m: F64, cadence_hz: F64, parameters: MotionParameters) -> F64:
    """Step lengths (n), m, by the bounce and by the walk ratio, weighted by their precisions.

    The walk ratio, step length over cadence, hardly differs between people and paces (Sekiya and
    Nagasaki 1998). The law of the bounce was fitted to brisk walkers: its sigma grows with the
    logarithm of how much slower the steps come than theirs.
    """
    slower = np.log(np.maximum(parameters.typical_cadence_hz / cadence_hz, 1.0))
    variance = parameters.bounce_law_sigma**2 + (parameters.bounce_law_sigma_if_slow * slower) ** 2
    weight = 1 / (1 + variance / parameters.walk_ratio_sigma**2)
    by_ratio_m = parameters.walk_ratio_m_per_hz * cadence_hz
    return np.asarray(by_bounce_m**weight * by_ratio_m ** (1 - weight))


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


CALIBRATED_SIGMA = 0.02
"""Over some fifty metres of known length the steps of one walker agree about as well."""


def calibrated(
    parameters: MotionParameters, scale: float, sigma: float = CALIBRATED_SIGMA
) -> MotionParameters:
    """The parameters of a walker whose steps are `scale` times as long as these say.

    `sigma` is how uncertain that factor is. The scale may come from anywhere: a known distance,
    a map, a device with its own odometry. Raises InputError where it is not positive.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"step scale: got {scale:g}, wanted more than 0; measure it again")
    return replace(parameters, step_scale=parameters.step_scale * scale, step_scale_sigma=sigma)


def calibrated_by_distance(
    imu: Imu, distance_m: float, parameters: MotionParameters, sigma: float = CALIBRATED_SIGMA
) -> MotionParameters:
    """The parameters of this walker, who walked `distance_m` along the path in this recording.

    The distance runs from the first footstep to the last, along the way (not as the crow flies).
    Raises InputError as `dead_reckon` does, or where the distance is not positive.
    """
    odometry = dead_reckon(imu, parameters)
    moves_m = np.diff(odometry.world_from_body[:, :2], axis=0)
    walked_m = float(np.linalg.norm(moves_m, axis=1).sum())
    if not distance_m > 0:
        raise InputError(f"distance: got {distance_m:g} m, wanted more than 0; measure it again")
    return calibrated(parameters, distance_m / walked_m, sigma)

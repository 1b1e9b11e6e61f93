"""Footsteps while the walk goes on: the pipeline's own stages over a window that slides along.

A footstep is final, and given out once, as soon as the walk has gone on for `live_delay_s` beyond
it. What left the window is remembered: the last footsteps, how far the phone had turned, and its
gyroscope at rest.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from elfslam.base.arrays import F64, Bool, Value, array
from elfslam.base.values import Imu
from elfslam.stages.motion.level import (
    NO_REST,
    Level,
    Rest,
    evenly_sampled,
    is_enough,
    level,
    rate_of,
    still_rows,
)
from elfslam.stages.motion.parameters import MotionParameters
from elfslam.stages.motion.reckoning import (
    STEPS_AROUND,
    footfalls,
    lengths_between,
    moves_between,
    phone_turn,
    smooth_heading,
    step_sigma,
)

REST_KEPT = 1.25
"""A rest leaves the window as a whole: until it ends, so many times `still_s` of it stay."""


@dataclass(frozen=True, eq=False)
class Steps(Value):
    """Steps between footsteps: when each ends and begins (n), its move and sigma (n, 3)."""

    t_s: F64 = array("n")
    from_s: F64 = array("n")
    moves: F64 = array("n", 3)
    sigma: F64 = array("n", 3)


@dataclass(frozen=True, eq=False)
class LivePdrState(Value):
    """A walk so far: its last readings, and what is remembered of those before them.

    The last footsteps given out, and where the walker headed at the last of them; how far the
    phone had turned as the window begins; and its gyroscope at rest before that.
    """

    window: Imu
    footsteps_t_s: F64 = array("k", increasing=True)
    heading_rad: float = 0.0
    turned_rad: float = 0.0
    rest: Rest = field(default=NO_REST)


NO_STEPS = Steps(np.zeros(0), np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3)))
BEGINNING = LivePdrState(Imu(np.zeros(0), np.zeros((0, 3)), np.zeros((0, 3))), np.zeros(0))


def go_on(
    walk: LivePdrState, newer: Imu, parameters: MotionParameters
) -> tuple[LivePdrState, Steps]:
    """The walk with newer readings, and the steps that became final.

    After a gap that is too long the walk begins anew; only the gyroscope at rest is remembered.
    Readings that are too few or too slow give no steps. Raises InputError where time runs back.
    """
    walk = _continued(walk, newer, parameters)
    if not is_enough(walk.window.t_s, parameters):
        return walk, NO_STEPS
    levelled = level(walk.window, parameters, walk.rest)
    known = len(walk.footsteps_t_s)
    newer_s = not_given(footfalls(levelled, parameters), walk.footsteps_t_s, parameters)
    count = known + len(final_footsteps(newer_s, float(levelled.t_s[-1]), parameters))
    footsteps_t_s = np.concatenate([walk.footsteps_t_s, newer_s])
    at_footsteps, halfway = _headings(walk, levelled, footsteps_t_s, parameters)
    steps = NO_STEPS
    if count > max(known, 1):
        lengths_m = lengths_between(levelled, footsteps_t_s, parameters)
        moves = moves_between(lengths_m, at_footsteps, halfway)
        sigma = step_sigma(lengths_m, parameters)
        ends = (footsteps_t_s[1:], footsteps_t_s[:-1])
        new = slice(max(known - 1, 0), count - 1)
        steps = Steps(*(each[new] for each in (*ends, moves, sigma)))
    walk = replace(
        walk,
        footsteps_t_s=footsteps_t_s[:count][-STEPS_AROUND:],
        heading_rad=float(at_footsteps[count - 1]) if count else 0.0,
    )
    return _slid(walk, levelled, parameters), steps


def not_given(found_s: F64, given_s: F64, parameters: MotionParameters) -> F64:
    """Footsteps found after the last one given out: what lies closer to it is that one again."""
    if len(given_s) == 0:
        return found_s
    return np.asarray(found_s[found_s > given_s[-1] + parameters.least_interval_s / 2])


def final_footsteps(found_s: F64, newest_s: float, parameters: MotionParameters) -> F64:
    """Footsteps that later readings hardly change: the walk has gone on long enough after them."""
    return np.asarray(found_s[found_s <= newest_s - parameters.live_delay_s])


def rest_kept(still: Bool, cut: int, least: int) -> int:
    """The row to cut at instead of `cut`: a rest (a run of `still`) is not cut to pieces.

    Until it ends, `least` rows of it stay.
    """
    if cut == 0 or not still[cut]:
        return cut
    awake = np.flatnonzero(~still[cut:])
    end = cut + int(awake[0]) if len(awake) else len(still)
    return max(0, min(cut, end - least))


def _continued(walk: LivePdrState, newer: Imu, parameters: MotionParameters) -> LivePdrState:
    rows = [
        np.concatenate([getattr(part, name) for part in (walk.window, newer)])
        for name in ("t_s", "accel_mps2", "gyro_radps")
    ]
    gaps = np.flatnonzero(np.diff(rows[0]) > parameters.longest_gap_s) + 1
    pieces = [Imu(*piece) for piece in zip(*(np.split(each, gaps) for each in rows), strict=True)]
    walk = replace(walk, window=pieces[0])
    for piece in pieces[1:]:
        walk = replace(BEGINNING, window=piece, rest=_rested(walk, np.inf, parameters))
    return walk


def _rested(walk: LivePdrState, until_s: float, parameters: MotionParameters) -> Rest:
    """The gyroscope at rest before the window, and in it until a time."""
    if not is_enough(walk.window.t_s, parameters):
        return walk.rest
    t_s, accel, gyro = evenly_sampled(walk.window)
    left = still_rows(accel, gyro, rate_of(t_s), parameters) & (t_s < until_s)
    return Rest(walk.rest.sum_radps + gyro[left].sum(axis=0), walk.rest.count + int(left.sum()))


def _headings(
    walk: LivePdrState, levelled: Level, footsteps_t_s: F64, parameters: MotionParameters
) -> tuple[F64, F64]:
    """Headings, rad, at the footsteps (n) and halfway between them (n-1).

    Footsteps that were given out and left the window keep the heading that is remembered.
    """
    heading_rad = walk.turned_rad + smooth_heading(levelled, parameters)
    at_footsteps = np.interp(footsteps_t_s, levelled.t_s, heading_rad)
    left = walk.footsteps_t_s < levelled.t_s[0] + parameters.heading_window_s / 2
    at_footsteps[: len(left)][left] = walk.heading_rad
    halfway_s = (footsteps_t_s[1:] + footsteps_t_s[:-1]) / 2
    return at_footsteps, np.interp(halfway_s, levelled.t_s, heading_rad)


def _slid(walk: LivePdrState, levelled: Level, parameters: MotionParameters) -> LivePdrState:
    """The walk without the readings that are older than the window, and what they told."""
    cut = int(np.searchsorted(levelled.t_s, levelled.t_s[-1] - parameters.live_window_s))
    t_s, accel, gyro = evenly_sampled(walk.window)
    still = still_rows(accel, gyro, levelled.rate_hz, parameters)
    cut = rest_kept(still, cut, int(REST_KEPT * parameters.still_s * levelled.rate_hz))
    row = int(np.searchsorted(walk.window.t_s, t_s[cut]))
    if row == 0:
        return walk
    begin_s = walk.window.t_s[row]
    rest = _rested(walk, begin_s, parameters)
    turned_rad = walk.turned_rad + float(np.interp(begin_s, t_s, phone_turn(levelled)))
    window = Imu(
        *(each[row:] for each in (walk.window.t_s, walk.window.accel_mps2, walk.window.gyro_radps))
    )
    return replace(walk, window=window, turned_rad=turned_rad, rest=rest)

"""People on a route: lanes beside it, stops, ways back, and a phone that is held anyhow.

A surveyor walks laps on one line (`walker.py`). People keep to lanes of their own, pass on either
side, stop, walk back a part of the way, and take the phone up anew, by its ports if need be; how
rough they walk and how their steps err is as measured of 215 surveyors of a mall (`python -m
studies sensors`).
"""

from dataclasses import fields, replace
from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from elfslam.base.arrays import F64
from elfslam.world.room import Room, floor_area_m2, standing_room
from elfslam.world.walker import (
    KINEMATICS_RATE_HZ,
    Motion,
    Straying,
    Walker,
    by_step,
    keeping_to_the_line,
    motion_along,
    on_lap,
    random_walker,
    smooth_lap,
    smooth_noise,
)

COVER_DB = (6.0, 20.0)
"""What a hand or a case over a port takes at 17.5 kHz, at least and at most."""
LANES_M = ((120.0, 0.3), (600.0, 0.5), (np.inf, 0.8))
"""Standard deviation of lanes in rooms, offices and halls: floor of up to so many m2."""
LANE_S = 25.0
"""How long a lane is kept."""
ASIDE_S = 3.0
WIDEST_M = 2.4
PROBE_M = 0.1
BESIDE = 160
"""Points of a lap, a centimetre apart, over which one makes room for what is beside the way."""
INSIDE = 1 / 3
"""How far into a bend one cuts, as a share of its radius."""
SLOW_M = 0.3 / KINEMATICS_RATE_HZ
"""Whoever goes on by less than this from moment to moment makes no way aside."""
STEP_TO_STEP_S = 0.1
"""How gently the length of one step goes over into that of the next."""
STOP_S = (1.0, 8.0)
TURN_S = 1.2
WAY_BACK_M = (2.0, 6.0)
GRIP_S = 0.8
COVER_SHARE = 0.25
"""Of the ways in which people take up a phone: a hand lies on one of its ports."""
UNREST_RADPS = (0.07, 0.17)
"""Of people's hands, walking or standing: the quietest second of a walk then scatters by what it
does in the median of real walks, of which two in three have nobody stand still in them."""


class Way(NamedTuple):
    """A lap (k, 2) through a room, its length, how it bends, and how far beside it one can go.

    `curvature_pm` (k) is positive where it turns left; `free_m` (k, 2) is right and left of it.
    """

    lap_xy: F64
    lap_m: float
    curvature_pm: F64
    free_m: F64


def random_person(generator: np.random.Generator, lane_m: float) -> Walker:
    """Someone who is no surveyor, and strays by `lane_m` (standard deviation)."""
    someone = random_walker(generator)
    return Walker(
        speed_mps=someone.speed_mps * generator.uniform(0.9, 1.1),
        step_factor=someone.step_factor,
        height_m=someone.height_m,
        pitch_rad=someone.pitch_rad,
        bounce_m=someone.bounce_m * generator.uniform(0.95, 1.05),
        body_distance_m=someone.body_distance_m,
        swing_rad=np.deg2rad(generator.uniform(2.8, 6.5)),
        nod_rad=np.deg2rad(generator.uniform(1.4, 3.2)),
        rock_rad=np.deg2rad(generator.uniform(1.8, 4.6)),
        tremor_rad=np.deg2rad(generator.uniform(0.2, 0.5)),
        step_noise=generator.uniform(0.1, 0.2),
        rhythm_noise=generator.uniform(0.05, 0.07),
        impact=generator.uniform(0.06, 0.075),
        unrest_radps=generator.spawn(1)[0].uniform(*UNREST_RADPS),
        lane_m=lane_m,
        aside_rad=np.deg2rad(7.5),
        stops_per_min=generator.uniform(0.0, 0.6),
        ways_back_per_min=generator.uniform(0.0, 0.25),
        grips_per_min=generator.uniform(0.0, 1.0),
        cover_share=COVER_SHARE,
    )


def lane_of(room: Room) -> float:
    """How far people stray in a room of this size (standard deviation, m)."""
    return next(lane for most, lane in LANES_M if floor_area_m2(room) <= most)


def stroll(
    person: Walker, route_m: F64, rounds: int, room: Room, generator: np.random.Generator
) -> Motion:
    """The motion of somebody who strays on `rounds` laps of the closed route (k, 2) in a room.

    They keep as far from walls and furniture as the free floor beside the route allows, and stand
    before and after for as long as they like.
    """
    return stroll_on(person, way_through(room, route_m), rounds, generator)


def way_through(room: Room, route_m: F64) -> Way:
    """The way along a closed route (k, 2), for as many who stroll on it as may come."""
    lap_xy, lap_m = smooth_lap(route_m)
    middle = np.arange(len(lap_xy), dtype=np.float64)
    turned = on_lap(lap_xy, middle + 0.5)[1] - on_lap(lap_xy, middle - 0.5)[1]
    curvature_pm = turned * len(lap_xy) / lap_m
    free_m = narrowed(free_beside(lap_xy, on_lap(lap_xy, middle)[1], curvature_pm, room))
    return Way(lap_xy, lap_m, curvature_pm, free_m)


def stroll_on(person: Walker, way: Way, rounds: int, generator: np.random.Generator) -> Motion:
    """The motion of somebody who strays on `rounds` laps of a way, as `stroll`."""
    pace, turned = stroller_velocity(person, rounds * way.lap_m, generator)
    velocity = by_uneven_steps(person, pace, generator)
    line = replace(keeping_to_the_line(np.abs(pace)), turned_rad=turned)
    along, straying, _ = astray(person, way, velocity, line, generator)
    return motion_along(person, way.lap_xy, way.lap_m, along, straying, generator)


def astray(
    person: Walker, way: Way, velocity: F64, line: Straying, generator: np.random.Generator
) -> tuple[F64, Straying, F64]:
    """How somebody who means to keep to a line strays beside it, and takes the longer for it.

    Velocity along the way (m), straying (m), and the moment of the plan (n) at each of these.
    """
    count, laps = len(velocity), np.cumsum(velocity) / way.lap_m / KINEMATICS_RATE_HZ
    regrips = _regrips(person, count, generator)
    left_m = _within(way, laps, person.lane_m * smooth_noise(generator, count, LANE_S))
    longer, slant = _beside(way, laps, left_m)
    straying = replace(
        line,
        left_m=left_m,
        turned_rad=line.turned_rad + slant,
        aside_rad=person.aside_rad * smooth_noise(generator, count, ASIDE_S),
        pitch_rad=_grips(regrips, count, np.deg2rad(6.0), generator),
        lower_m=_grips(_regrips(person, count, generator), count, 0.05, generator),
        covered_db=_covered(person, regrips, count, generator),
    )
    planned, at = np.arange(count), _moments(longer)
    rows = (getattr(straying, each.name) for each in fields(straying))
    lasting = Straying(*(np.interp(at, planned, row) for row in rows))
    return np.interp(at, planned, velocity / longer), lasting, at


def by_uneven_steps(person: Walker, pace: F64, generator: np.random.Generator) -> F64:
    """Velocity (n) whose steps err in length, at the same rhythm; all in all as far."""
    if not person.step_noise:
        return pace
    gently = STEP_TO_STEP_S * KINEMATICS_RATE_HZ
    uneven = pace * (
        1 + person.step_noise * gaussian_filter1d(by_step(generator, len(pace)), gently)
    )
    return np.asarray(uneven * (pace.sum() / uneven.sum()))


def _beside(way: Way, laps: F64, left_m: F64) -> tuple[F64, F64]:
    """How much longer a lane is than the lap beside it, and how it slants (n, rad), by moment."""
    ahead_m = np.gradient(laps) * way.lap_m
    slope = np.gradient(left_m) / np.maximum(np.abs(ahead_m), SLOW_M)
    straight = 1 - _on_way(way.curvature_pm, laps) * left_m
    return np.hypot(straight, slope), np.sign(ahead_m) * np.arctan2(slope, straight)


def _moments(longer: F64) -> F64:
    """Which plan's moment each moment is, if each of the plan's (n) lasts so many times longer.

    A lane outside a bend is a longer way than the lap: it takes more steps, not longer ones.
    """
    passed = np.cumsum(longer) - longer[0]
    return np.interp(np.arange(int(passed[-1]) + 1), passed, np.arange(len(longer)))


def stroller_velocity(
    person: Walker, way_m: float, generator: np.random.Generator
) -> tuple[F64, F64]:
    """Signed velocity along the lap (n), and by how much the walker has turned round (n)."""
    parts, turns, gone_m = [_still(generator)], [0.0], 0.0
    stops, backs = person.stops_per_min, person.ways_back_per_min
    while gone_m < way_m - 0.01:
        until_m = way_m - gone_m
        if stops + backs > 0:
            until_m = min(until_m, person.speed_mps * generator.exponential(60 / (stops + backs)))
        parts.append(leg(person, max(until_m, 0.5), generator))
        turns.append(0.0)
        gone_m += max(until_m, 0.5)
        if gone_m < way_m - 3.0 and generator.uniform() < backs / max(stops + backs, 1e-9):
            back_m = min(generator.uniform(*WAY_BACK_M), gone_m)
            parts += [_standing(TURN_S), -leg(person, back_m, generator), _standing(TURN_S)]
            turns += [np.pi, np.pi, 0.0]
            gone_m -= back_m
        else:
            parts.append(_still(generator))
            turns.append(0.0)
    velocity = gaussian_filter1d(np.concatenate(parts), 0.15 * KINEMATICS_RATE_HZ)
    turned = np.repeat(turns, [len(part) for part in parts])
    return velocity, gaussian_filter1d(turned, TURN_S / 4 * KINEMATICS_RATE_HZ, mode="nearest")


def leg(person: Walker, length_m: float, generator: np.random.Generator) -> F64:
    """Speed (n) of somebody who sets out and goes so far."""
    most = int(length_m / (0.4 * person.speed_mps) * KINEMATICS_RATE_HZ) + 800
    speed = person.speed_mps * (1 + 0.1 * smooth_noise(generator, most, 4.0))
    speed = np.maximum(speed, 0.5 * person.speed_mps)
    speed *= np.clip(np.arange(most) / KINEMATICS_RATE_HZ + 0.05, 0.0, 1.0)
    gone_m = np.cumsum(speed) / KINEMATICS_RATE_HZ
    kept = speed[: int(np.searchsorted(gone_m, length_m)) + 1]
    return np.asarray(kept * length_m * KINEMATICS_RATE_HZ / kept.sum())


def _standing(seconds: float) -> F64:
    return np.zeros(round(seconds * KINEMATICS_RATE_HZ))


def _still(generator: np.random.Generator) -> F64:
    return _standing(generator.uniform(*STOP_S))


def _regrips(person: Walker, count: int, generator: np.random.Generator) -> F64:
    """When the phone is taken up anew, in samples."""
    minutes = count / KINEMATICS_RATE_HZ / 60
    return np.sort(generator.uniform(0, count, generator.poisson(person.grips_per_min * minutes)))


def _grips(regrips: F64, count: int, size: float, generator: np.random.Generator) -> F64:
    """How the phone is held beside how it was at first: another way after every new grip."""
    return _from_grip_to_grip(regrips, size * generator.standard_normal(len(regrips)), count)


def _covered(person: Walker, regrips: F64, count: int, generator: np.random.Generator) -> F64:
    """What grips take of the sound at a port (dB); drawn from a child, which leaves the rest."""
    child = generator.spawn(1)[0]
    if not person.cover_share:
        return np.zeros(count)
    covers = child.uniform(size=len(regrips)) < person.cover_share
    return _from_grip_to_grip(regrips, covers * child.uniform(*COVER_DB, len(regrips)), count)


def _from_grip_to_grip(regrips: F64, values: F64, count: int) -> F64:
    """What each new grip brings, from it to the next (n); none before the first."""
    steps = np.append(0.0, values)[np.searchsorted(regrips, np.arange(count))]
    return np.asarray(gaussian_filter1d(steps, GRIP_S * KINEMATICS_RATE_HZ / 2, mode="nearest"))


def free_beside(xy_m: F64, heading_rad: F64, curvature_pm: F64, room: Room) -> F64:
    """How far one goes to the right and to the left of each point (k, 2) of a way, in m."""
    left = np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
    free = np.zeros((len(xy_m), 2))
    for column, sign in enumerate((-1.0, 1.0)):
        open_so_far = np.ones(len(xy_m), dtype=bool)
        for far in np.arange(PROBE_M, WIDEST_M, PROBE_M):
            beside = xy_m[open_so_far] + sign * far * left[open_so_far]
            open_so_far[open_so_far] = standing_room(room, beside)
            free[open_so_far, column] = far
        inward = np.maximum(sign * curvature_pm, 1e-3)
        free[:, column] = np.minimum(free[:, column], INSIDE / inward)
    return free


def narrowed(free_m: F64) -> F64:
    """The least of what is free (k, 2) just before and behind, softly."""
    least = minimum_filter1d(free_m, BESIDE, axis=0, mode="wrap")
    return np.asarray(gaussian_filter1d(least, BESIDE / 4, axis=0, mode="wrap"))


def _within(way: Way, laps: F64, wanted_m: F64) -> F64:
    """A lane (n) that keeps to the free floor at each moment, bent softly where it is narrow."""
    right, left = (_on_way(side, laps) for side in way.free_m.T)
    most = np.maximum(np.where(wanted_m > 0, left, right), 1e-3)
    return np.asarray(np.where(wanted_m > 0, 1.0, -1.0) * most * np.tanh(np.abs(wanted_m) / most))


def _on_way(values: F64, laps: F64) -> F64:
    """What belongs to the points of a lap (k), at places on it (n) in laps."""
    at = laps % 1.0 * len(values)
    return np.asarray(np.interp(at, np.arange(len(values) + 1), np.append(values, values[0])))

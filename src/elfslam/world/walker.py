"""A walker with a phone: where the phone is and how it is held, at every moment."""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d

from elfslam.base.arrays import F64, Value, array

KINEMATICS_RATE_HZ = 400.0
TYPICAL_STEP_M = 0.68
TYPICAL_SPEED_MPS = 1.25
TYPICAL_CADENCE_HZ = TYPICAL_SPEED_MPS / TYPICAL_STEP_M
CORNER_RADIUS_M = 0.45
UNREST_S = 0.1
"""Of a hand's unrest, about; its rate of turn is then strongest at 3 to 6 Hz, as in people who
stand (`python -m studies sensors`)."""


@dataclass(frozen=True)
class Walker:
    """A person: gait and the way the phone is held; by default a surveyor, who keeps to one line.

    `step_factor` is the true step length over the typical one at the same cadence; at the same
    speed it enters as its square root. It is hidden from the line. Besides it, speed errs from
    step to step by `step_noise`, and the time that a step takes by `rhythm_noise`. `impact` is how
    hard a foot comes down, as a share of the bounce. `unrest_radps` is the rate at which a hand
    trembles about each axis (rms), walking or standing.
    Others stray (`stroll.py`): `lane_m` is the standard deviation of the lane that they keep to,
    `aside_rad` that of the angle at which they hold the phone, and they stop, walk back a bit and
    change their grip so many times a minute; `cover_share` of the new grips cover a port.
    """

    speed_mps: float
    step_factor: float
    height_m: float
    pitch_rad: float
    bounce_m: float
    sway_m: float = 0.015
    wander_m: float = 0.10
    wobble_rad: float = np.deg2rad(4.0)
    swing_rad: float = np.deg2rad(1.5)
    nod_rad: float = np.deg2rad(1.0)
    rock_rad: float = 0.0
    tremor_rad: float = np.deg2rad(0.15)
    body_distance_m: float = 0.35
    step_noise: float = 0.0
    rhythm_noise: float = 0.0
    impact: float = 0.0
    unrest_radps: float = 0.0
    lane_m: float = 0.0
    aside_rad: float = 0.0
    stops_per_min: float = 0.0
    ways_back_per_min: float = 0.0
    grips_per_min: float = 0.0
    cover_share: float = 0.0


@dataclass(frozen=True, eq=False)
class Straying(Value):
    """What a walker does beside following the route (n): but the pace, zeros for a surveyor.

    `pace_mps` is how fast they mean to go, which sets the steps; `left_m` is the lane, to the left
    of the route; `turned_rad` is what the lane slants, and pi on the way back; `aside_rad`,
    `pitch_rad` and `lower_m` are how the phone is held, and `covered_db` what the hand takes of the
    sound at its loudspeaker. `ground_m` is how high they stand, on stairs or in a lift, and
    `bounce` how many times as hard as on the flat they tread there.
    """

    pace_mps: F64 = array("n")
    left_m: F64 = array("n")
    turned_rad: F64 = array("n")
    aside_rad: F64 = array("n")
    pitch_rad: F64 = array("n")
    lower_m: F64 = array("n")
    covered_db: F64 = array("n")
    ground_m: F64 = array("n")
    bounce: F64 = array("n")


@dataclass(frozen=True, eq=False)
class Motion(Value):
    """The phone along a walk at 400 Hz: position, yaw, pitch and roll, and the walking heading.

    `covered_db` is what a hand takes of the sound at its loudspeaker; without, nothing.
    """

    t_s: F64 = array("n", increasing=True)
    position_m: F64 = array("n", 3)
    yaw_rad: F64 = array("n")
    pitch_rad: F64 = array("n")
    roll_rad: F64 = array("n")
    heading_rad: F64 = array("n")
    steps: F64 = array("n")
    covered_db: F64 | None = array("n", optional=True)


def keeping_to_the_line(pace_mps: F64) -> Straying:
    """That of a surveyor, on flat ground."""
    none = np.zeros(len(pace_mps))
    return Straying(pace_mps, none, none, none, none, none, none, none, np.ones(len(pace_mps)))


def random_walker(generator: np.random.Generator) -> Walker:
    """Someone: speed 1.0 to 1.4 m/s, steps up to 10 % off the typical length at their cadence."""
    return Walker(
        speed_mps=generator.uniform(1.0, 1.4),
        step_factor=generator.uniform(0.9, 1.1),
        height_m=generator.uniform(1.1, 1.35),
        pitch_rad=generator.uniform(0.25, 0.6),
        bounce_m=generator.uniform(0.0265, 0.0295),
        body_distance_m=generator.uniform(0.30, 0.40),
    )


def walk(
    walker: Walker,
    route_m: F64,
    rounds: int,
    generator: np.random.Generator,
    standing_s: float = 2.0,
) -> Motion:
    """The motion of `rounds` laps of the closed route (k, 2), standing still before and after."""
    lap_xy, lap_m = smooth_lap(route_m)
    dt_s = 1 / KINEMATICS_RATE_HZ
    upper_s = rounds * lap_m / (0.6 * walker.speed_mps) + 2 * standing_s
    count = round(upper_s / dt_s)
    speed = walker.speed_mps * (1 + 0.08 * smooth_noise(generator, count, 4.0))
    speed = np.maximum(speed, 0.5 * walker.speed_mps) * _ramp(count, dt_s, standing_s)
    distance = np.cumsum(speed) * dt_s
    end = int(np.searchsorted(distance, rounds * lap_m))
    count = min(end + round(standing_s / dt_s), count)
    moving = speed[:count] * (np.arange(count) < end)
    moving = gaussian_filter1d(moving, 0.15 / dt_s)
    straying = keeping_to_the_line(moving)
    return motion_along(walker, lap_xy, lap_m, moving, straying, generator)


def motion_along(
    walker: Walker,
    lap_xy: F64,
    lap_m: float,
    velocity: F64,
    straying: Straying,
    generator: np.random.Generator,
) -> Motion:
    """The motion of somebody who goes along a lap (k, 2) at a velocity (n), and strays from it."""
    distance = np.cumsum(velocity) * (1 / KINEMATICS_RATE_HZ)
    share = distance / lap_m * len(lap_xy)
    return motion_on(walker, *on_lap(lap_xy, share), straying, generator)


def motion_on(
    walker: Walker, xy: F64, heading: F64, straying: Straying, generator: np.random.Generator
) -> Motion:
    """The motion of somebody who would be at places (n, 2) and head so (n), and strays from it."""
    count, dt_s = len(xy), 1 / KINEMATICS_RATE_HZ
    beside = np.column_stack([-np.sin(heading), np.cos(heading)]) * straying.left_m[:, None]
    heading = heading + straying.turned_rad
    xy = gaussian_filter1d(xy, 0.04 / dt_s, axis=0, mode="nearest")
    heading = gaussian_filter1d(heading, 0.04 / dt_s, mode="nearest")
    cadence = cadence_hz(walker, straying.pace_mps)
    if walker.rhythm_noise:
        cadence = cadence / (1 + walker.rhythm_noise * by_step(generator, count))
    steps = np.cumsum(cadence) * dt_s
    gait = np.minimum(straying.pace_mps / walker.speed_mps, 1.0)
    left = np.column_stack([-np.sin(heading), np.cos(heading)])
    forward = np.column_stack([np.cos(heading), np.sin(heading)])
    wander = walker.wander_m * smooth_noise(generator, count, 6.0)
    xy = xy + left * (wander + gait * walker.sway_m * np.sin(np.pi * steps))[:, None]
    xy = xy + forward * (0.008 * gait * np.sin(2 * np.pi * steps + 0.6))[:, None] + beside
    stride = np.cos(2 * np.pi * steps) + 0.25 * np.cos(4 * np.pi * steps + 0.9)
    if walker.impact:
        stride = stride + walker.impact * np.cos(8 * np.pi * steps + 0.4)
    z = walker.height_m + 0.02 * smooth_noise(generator, count, 8.0)
    z = (
        z
        + walker.bounce_m * gait**1.5 * stride * straying.bounce
        - straying.lower_m
        + straying.ground_m
    )
    wobble = walker.wobble_rad * smooth_noise(generator, count, 10.0)
    tremor = walker.tremor_rad * smooth_noise(generator, count, 0.3)
    yaw = (
        heading
        + straying.aside_rad
        + wobble
        + tremor
        + gait * walker.swing_rad * np.sin(np.pi * steps + 0.4)
    )
    pitch = walker.pitch_rad + 0.03 * smooth_noise(generator, count, 8.0)
    pitch = pitch + gait * walker.nod_rad * np.sin(2 * np.pi * steps) + straying.pitch_rad
    roll = 0.03 * smooth_noise(generator, count, 8.0)
    roll = roll + gait * walker.rock_rad * np.sin(np.pi * steps + 1.3)
    t_s = np.asarray(np.arange(count) * dt_s, dtype=np.float64)
    position = np.column_stack([xy, z])
    angles = np.stack([yaw, pitch, roll])
    if walker.unrest_radps:
        angles = angles + _unrest(walker, count, generator.spawn(1)[0])
    yaw, pitch, roll = angles
    return Motion(t_s, position, yaw, pitch, roll, heading, steps, straying.covered_db)


def _unrest(walker: Walker, count: int, generator: np.random.Generator) -> F64:
    """Angles (3, n) by which a hand trembles; drawn from a child, which leaves all else."""
    noise = np.stack([smooth_noise(generator, count, UNREST_S) for _ in range(3)])
    rate = np.gradient(noise, 1 / KINEMATICS_RATE_HZ, axis=1)
    return np.asarray(noise * (walker.unrest_radps / rate.std(axis=1, keepdims=True)))


def cadence_hz(walker: Walker, speed_mps: F64) -> F64:
    """Steps per second: step length grows with the square root of speed."""
    relative = np.maximum(speed_mps, 0.0) / (walker.step_factor * TYPICAL_SPEED_MPS)
    return np.asarray(TYPICAL_CADENCE_HZ * np.sqrt(relative))


def smooth_lap(route_m: F64) -> tuple[F64, float]:
    """The closed route with rounded corners, evenly sampled about every centimetre; its length."""
    rough = _evenly_sampled(route_m)[0]
    return _evenly_sampled(gaussian_filter1d(rough, CORNER_RADIUS_M / 0.01, axis=0, mode="wrap"))


def _evenly_sampled(ring_m: F64) -> tuple[F64, float]:
    closed = np.vstack([ring_m, ring_m[:1]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at = np.linspace(0.0, along[-1], round(along[-1] / 0.01), endpoint=False)
    return np.column_stack([np.interp(at, along, closed[:, k]) for k in range(2)]), float(along[-1])


def on_lap(lap_xy: F64, share: F64) -> tuple[F64, F64]:
    """Position and heading at fractional index `share` along the closed lap."""
    index = np.arange(len(lap_xy) + 1)
    ring = np.vstack([lap_xy, lap_xy[:1]])
    at = share % len(lap_xy)
    xy = np.column_stack([np.interp(at, index, ring[:, k]) for k in range(2)])
    tangent = np.roll(lap_xy, -5, axis=0) - np.roll(lap_xy, 5, axis=0)
    closed = np.vstack([tangent, tangent[:1]])
    turns = np.unwrap(np.arctan2(closed[:, 1], closed[:, 0]))
    lap = share // len(lap_xy)
    return xy, np.interp(at, index, turns) + lap * (turns[-1] - turns[0])


def by_step(generator: np.random.Generator, count: int) -> F64:
    """Unit-variance noise (n) that changes as often as steps; none is off by more than twice.

    It keeps no step with the feet: most steps share two of its values, and scatter two thirds as
    much.
    """
    at = (np.arange(count) * TYPICAL_CADENCE_HZ / KINEMATICS_RATE_HZ).astype(int)
    knots = generator.standard_normal(count and at[-1] + 1)
    return np.asarray(np.clip(knots[at], -2.0, 2.0))


def smooth_noise(generator: np.random.Generator, count: int, period_s: float) -> F64:
    """Unit-variance noise at 400 Hz that changes over about `period_s`."""
    dt_s = 1 / KINEMATICS_RATE_HZ
    knots = max(int(count * dt_s / period_s * 4) + 8, 8)
    coarse = gaussian_filter1d(generator.standard_normal(knots), 1.5, mode="wrap")
    coarse /= np.sqrt(1.0 / (2 * np.sqrt(np.pi) * 1.5))
    at = np.arange(count) * dt_s / (period_s / 4)
    rough = np.interp(at, np.arange(knots), coarse)
    return np.asarray(gaussian_filter1d(rough, period_s / 8 / dt_s, mode="nearest"))


def _ramp(count: int, dt_s: float, standing_s: float) -> F64:
    """0 while standing, then up to 1 within a second."""
    t_s = np.arange(count) * dt_s - standing_s
    return np.asarray(np.clip(t_s, 0.0, 1.0))

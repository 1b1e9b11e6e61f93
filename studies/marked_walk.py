"""A walk of several rounds that steps on the same 58 markers of the lab in every round."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.values import Echoes, Odometry
from elfslam.world.phone import Poses, phone_axes
from elfslam.world.world_file import World
from studies.still_phone import BODY_M, HEIGHT_M, PITCH_RAD, hear_at, listener_in

MARKERS = 58
ROUTE_M = np.array([[0.66, 1.5], [10.46, 1.5], [10.46, 12.85], [0.66, 12.85]])
"""Round two islands of cubicles: 42.3 m, 0.73 m from marker to marker."""
SPEED_MPS = 5 / 3.6
PACE = 0.03
"""How much the time of a step varies, one standard deviation, as a share of it."""
FOOT_M = 0.03
FOOT_RAD = np.deg2rad(3.0)
"""How far the phone is off at each footstep, one standard deviation, in every direction."""
BOUNCE_M = 0.028
PERIOD_S = 0.1
INSTANT_S = 0.01


def walk_over_markers(
    world: World, rounds: int, generator: np.random.Generator
) -> tuple[Odometry, Echoes]:
    """The footsteps (58 per round, and the one that closes the last) and the echoes between."""
    markers = marker_poses()
    step_s = np.linalg.norm(np.diff(markers[:2, :2], axis=0)) / SPEED_MPS
    steps = rounds * MARKERS
    steps_s = np.cumsum(step_s * (1 + PACE * generator.standard_normal(steps)))
    footsteps_s = np.concatenate([[0.0], steps_s])
    held = _held_at_footsteps(markers, steps + 1, generator)
    t_s = np.arange(generator.uniform(0, PERIOD_S), footsteps_s[-1], PERIOD_S)
    samples = hear_at(listener_in(world.room), _poses(footsteps_s, held, t_s), generator)
    nodes = Odometry(footsteps_s, held[:, [0, 1, 3]], np.full((steps, 3), FOOT_M))
    return nodes, Echoes(t_s, samples, np.zeros((0, 2)))


def marker_poses() -> F64:
    """Markers (58, 3) evenly along the route, each with the way that the walker faces there."""
    closed = np.vstack([ROUTE_M, ROUTE_M[:1]])
    along_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(closed, axis=0), axis=1))])
    at_m = np.linspace(0.0, along_m[-1], MARKERS, endpoint=False)
    xy_m = np.column_stack([np.interp(at_m, along_m, closed[:, axis]) for axis in range(2)])
    ahead = np.roll(xy_m, -1, axis=0) - np.roll(xy_m, 1, axis=0)
    return np.column_stack([xy_m, np.arctan2(ahead[:, 1], ahead[:, 0])])


def _held_at_footsteps(markers: F64, count: int, generator: np.random.Generator) -> F64:
    """Where and how the phone is held at each footstep (n, 6): x, y, z, yaw, pitch and roll."""
    on = markers[np.arange(count) % MARKERS]
    still = np.tile([HEIGHT_M, 0.0, PITCH_RAD, 0.0], (count, 1))
    held = np.column_stack([on[:, :2], still])
    held[:, 3] = np.unwrap(on[:, 2])
    scatter = np.repeat([FOOT_M, FOOT_RAD], 3)
    return np.asarray(held + scatter * generator.standard_normal(held.shape))


def _poses(footsteps_s: F64, held: F64, t_s: F64) -> Poses:
    """The phone at each of the times, moving on from footstep to footstep."""

    def at(when_s: F64) -> F64:
        now = np.column_stack([np.interp(when_s, footsteps_s, column) for column in held.T])
        share = np.interp(when_s, footsteps_s, np.arange(len(footsteps_s)))
        now[:, 2] += BOUNCE_M * np.cos(2 * np.pi * share)
        return now

    now, moved = at(t_s), at(t_s + INSTANT_S) - at(t_s - INSTANT_S)
    return Poses(
        now[:, :3], phone_axes(*now[:, 3:].T), moved[:, :3] / (2 * INSTANT_S),
        np.full(len(t_s), BODY_M), np.zeros((len(t_s), 0, 2)),
    )  # fmt: skip

"""Mapped walks of many people over the same ground, for maps to be made of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from elfslam.app.settings import Settings
from elfslam.base.arrays import F64
from elfslam.base.geometry import interpolate_poses
from elfslam.base.values import Recording, Trajectory, Truth
from elfslam.slam.merging import MappedWalk, walk_of
from elfslam.slam.pipeline import map_by_echoes
from elfslam.world.kinds import SURVEYOR, kind_named
from elfslam.world.room import fault_of_route
from elfslam.world.simulate import load_world
from elfslam.world.world_file import World
from studies.cached import simulate
from studies.localization import shipped

CORNER_SIGMA_M = 0.15
"""How far the corners of one walker's route lie from another's."""
TRIES = 1000
TOGETHER_M = 0.6
"""Footsteps of two walks this close in a map lie together there."""
WHOLE, FIRST, SECOND = "whole", "first part", "second part"
MOVED = "moved"
MAP, WALKS = "map", "walks in the map"
"""The method whose error is the map's own, and how many walks came into it."""


@dataclass(frozen=True)
class Stroll:
    """A walk of one person: over the whole route, or there and back over a part of it.

    A `later` one is of another day, with another phone.
    """

    world: str
    seed: int
    rounds: int = 3
    part: str = WHOLE
    reverse: bool = False
    state: str = ""
    later: bool = False
    kind: str = SURVEYOR.name


@cache
def strolled(stroll: Stroll) -> tuple[MappedWalk, Truth]:
    """The walk as it is mapped by itself, its start unknown, and the truth."""
    recording, truth = recorded(stroll)
    run = map_by_echoes(recording, shipped(), Settings())
    return replace(walk_of(run), name=repr(stroll)), truth


def recorded(stroll: Stroll) -> tuple[Recording, Truth]:
    """The recording of a walk, and the truth."""
    world, kind = _routed(stroll), kind_named(stroll.kind)
    today = kind.asking(world.room) if stroll.later else kind.mapping(world.room)
    return simulate(
        world, stroll.seed, rounds=stroll.rounds, reverse=stroll.reverse, walker=kind.walker,
        circumstances=replace(today, state=stroll.state),
    )  # fmt: skip


def truly_apart_m(trajectories: Sequence[Trajectory], truths: Sequence[Truth]) -> F64:
    """How far apart two walks truly are (k) at footsteps that lie together in their common map.

    That is what a merger claims; how bent the map is as a whole says more of the walks.
    """
    (one, other), (one_true, other_true) = (
        [walk.world_from_body[:, :2] for walk in trajectories],
        [
            interpolate_poses(truth.t_s, truth.world_from_body, walk.t_s)[:, :2]
            for walk, truth in zip(trajectories, truths, strict=True)
        ],
    )
    away_m, near = cKDTree(one).query(other, distance_upper_bound=TOGETHER_M)
    known = np.isfinite(away_m)
    return np.asarray(np.linalg.norm(one_true[near[known]] - other_true[known], axis=1))


def one_after_another(
    trajectories: Sequence[Trajectory], truths: Sequence[Truth]
) -> tuple[Trajectory, Truth]:
    """Walks of one frame as one long walk, and its truth: to be aligned and judged as a whole."""
    pairs = list(zip(trajectories, truths, strict=True))
    lasts_s = [max(walk.t_s[-1], truth.t_s[-1]) + 1.0 for walk, truth in pairs]
    begins_s = np.cumsum([0.0, *lasts_s])
    t_s = [walk.t_s + begin for walk, begin in zip(trajectories, begins_s, strict=False)]
    true_s = [truth.t_s + begin for truth, begin in zip(truths, begins_s, strict=False)]
    poses = np.vstack([walk.world_from_body for walk in trajectories])
    covariance = np.concatenate([walk.covariance for walk in trajectories])
    known = np.vstack([truth.world_from_body for truth in truths])
    walked = Trajectory(np.concatenate(t_s), poses, covariance, np.empty(0), "OK")
    return walked, Truth(np.concatenate(true_s), known)


def _routed(stroll: Stroll) -> World:
    """The world with the route of this walker: it starts at any corner, each a little elsewhere."""
    world = load_world(stroll.world)
    generator = np.random.default_rng([stroll.seed, 2])
    corners = _part(world.route_m, stroll.part)
    for _ in range(TRIES):
        route_m = corners + generator.normal(0, CORNER_SIGMA_M, corners.shape)
        if stroll.part == WHOLE:
            route_m = np.roll(route_m, -int(generator.integers(len(route_m))), axis=0)
        else:
            route_m = np.vstack([route_m, route_m[-2:0:-1]])
        if fault_of_route(world.room, route_m, closed=True) is None:
            return replace(world, route_m=route_m)
    return world


def _part(route_m: F64, part: str) -> F64:
    """The corners of the route, or of a part; between both parts lies a leg that none walks."""
    half = len(route_m) // 2
    return {WHOLE: route_m, FIRST: route_m[: half - 1], SECOND: route_m[half : 2 * half - 1]}[part]

"""Routes of query walks: they cross the mapped one, leave it and come back to it."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64
from elfslam.world.room import Room
from elfslam.world.walkable import in_the_way
from elfslam.world.walker import smooth_lap

TRIES = 400
SHARES = (0.25, 0.6)
"""Of the lap, that is cut off."""
LEFT_OUT_M = 1.0
"""So far from the lap a shortcut leads at least."""
PROBES = 9
CORNER_M = 0.5
"""Spacing of the new route's corners along the part of the lap that is kept."""


def crossing_route(room: Room, route_m: F64, generator: np.random.Generator) -> F64:
    """A closed route (k, 2) that keeps a part of another one and cuts straight across the rest.

    The other one itself where no straight way across the room is free.
    """
    lap_xy, _ = smooth_lap(route_m)
    for _ in range(TRIES):
        first = int(generator.integers(len(lap_xy)))
        cut = int(generator.uniform(*SHARES) * len(lap_xy))
        kept = np.roll(lap_xy, -(first + cut), axis=0)[: len(lap_xy) - cut]
        if _leads_across(room, lap_xy, kept[-1], kept[0]):
            return np.vstack([kept[: -1 : round(CORNER_M / 0.01)], kept[-1:]])
    return route_m


def _leads_across(room: Room, lap_xy: F64, start: F64, end: F64) -> bool:
    """Whether the straight way is free and leaves the lap."""
    way = start + np.linspace(0.1, 0.9, PROBES)[:, None] * (end - start)
    away_m = np.linalg.norm(way[:, None] - lap_xy[None, ::10], axis=2).min(axis=1)
    return bool(away_m.max() > LEFT_OUT_M) and in_the_way(room, start, end) is None

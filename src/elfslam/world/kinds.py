"""Kinds of walks: who walks, in which sound, and what differs between mapping and query walks.

A controlled scenario has one line, one phone, mirror images. In realistic ones phones
are ordinary, rooms scatter, are as warm as people like it and have their doors open or shut, others
are about, and query walks are of another day with another phone, by other ways where they are
people.
"""

from dataclasses import dataclass, replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import ParameterError
from elfslam.world.circumstances import Circumstances
from elfslam.world.room import Room, floor_area_m2, in_the_way
from elfslam.world.walker import smooth_lap
from elfslam.world.world_file import World, walked_room

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
    way = start + np.linspace(0.1, 0.9, PROBES)[:, None] * (end - start)
    away_m = np.linalg.norm(way[:, None] - lap_xy[None, ::10], axis=2).min(axis=1)
    return bool(away_m.max() > LEFT_OUT_M) and in_the_way(room, start, end) is None


PEOPLE_ABOUT = ((120.0, 0), (600.0, 3), (float("inf"), 6))
"""Others about in rooms, offices and halls: floor of up to so many m2."""
DAYS_LATER = 20
"""For a query walk a third of the low furniture has been moved a little, the air is another."""
MAPPING_PHONE, ASKING_PHONE = "ordinary phone", "other ordinary phone"


@dataclass(frozen=True)
class Kind:
    """A kind of walk: `walker` as `simulate` has it, in a realistic or controlled scenario."""

    name: str
    walker: str
    ordinary: bool

    def mapping(self, room: Room) -> Circumstances:
        """The circumstances of walks that are mapped."""
        if not self.ordinary:
            return Circumstances()
        return _ordinary(room, MAPPING_PHONE, day=0)

    def asking(self, room: Room) -> Circumstances:
        """The circumstances of walks that are located in a map of the same kind."""
        if not self.ordinary:
            return Circumstances()
        return _ordinary(room, ASKING_PHONE, DAYS_LATER)

    def asking_place(self, world: World, seed: int) -> World:
        """The world with the route of a query: a surveyor's is the mapped one, people's crosses
        it."""
        if self.walker == SURVEYOR.walker:
            return world
        generator = np.random.default_rng([seed, 31])
        return replace(world, route_m=crossing_route(walked_room(world), world.route_m, generator))


def _ordinary(room: Room, device: str, day: int) -> Circumstances:
    return Circumstances(
        engine="diffuse", people=people_about(room), device=device, day=day, lived_in=True
    )


QUIET = Kind("quiet", "surveyor", ordinary=False)
SURVEYOR = Kind("surveyor", "surveyor", ordinary=True)
PEOPLE = Kind("people", "person", ordinary=True)
KINDS = {kind.name: kind for kind in (PEOPLE, SURVEYOR, QUIET)}


def kind_named(name: str) -> Kind:
    """The kind of this name. Raises ParameterError for another."""
    if name not in KINDS:
        raise ParameterError(f"kind {name!r}: wanted {', '.join(KINDS)}; correct it")
    return KINDS[name]


def people_about(room: Room) -> int:
    """How many others are about in a room of this size."""
    return next(people for most, people in PEOPLE_ABOUT if floor_area_m2(room) <= most)

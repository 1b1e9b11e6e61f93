"""Doors: leaves on hinges in openings of walls, which a day finds open or shut.

A door in a partition's gap closes it with its leaves, or has them stand at an angle. One in an
outer wall is that wall while it is shut; open, nothing that enters the doorway comes back, and the
leaves stand in the room.
"""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from elfslam.base.arrays import F64, Value, array
from elfslam.world.materials import Material
from elfslam.world.room import HALF_WIDTH_M, TOUCH_M, Block, Room, point_gap_m, segment_gap_m

OPEN_SHARE = 0.5
"""Of the doors on a day; an estimate."""
THICK_M = 0.04
"""Of a leaf."""
DOORWAY = Material("doorway", 1.0, 0.0, "an opening, from which nothing comes back")
DEEP_M = 0.02
"""Of the doorway before its wall."""


@dataclass(frozen=True, eq=False)
class HingedDoor(Value):
    """An opening between two ends in plan, and what closes it.

    One leaf is hinged at `from_m`, two at either end. Open, they are turned by `open_rad` to the
    left of the way from `from_m` to `to_m`, where it is negative to the right.
    """

    name: str
    surface: Material
    from_m: F64 = array(2)
    to_m: F64 = array(2)
    height_m: float = 2.1
    open_rad: float = np.pi / 2
    leaves: int = 1


def leaf_ends(door: HingedDoor, *, is_open: bool) -> F64:
    """Hinge and far end of every leaf in plan (leaves, 2, 2)."""
    leaf_m = (door.to_m - door.from_m) / door.leaves
    turn = door.open_rad if is_open else 0.0
    cos, sin = np.cos(turn), np.sin(turn)
    first = leaf_m @ np.array([[cos, sin], [-sin, cos]])
    other = -leaf_m @ np.array([[cos, -sin], [sin, cos]])
    ends = [[door.from_m, door.from_m + first], [door.to_m, door.to_m + other]]
    return np.array(ends[: door.leaves])


def in_outer_wall(door: HingedDoor, room: Room) -> bool:
    """Whether it is a part of one side of the room's outline."""
    ends = np.stack([door.from_m, door.to_m])
    sides = zip(room.outline_m, np.roll(room.outline_m, -1, axis=0), strict=True)
    return any(point_gap_m(ends, a, b).max() < DEEP_M for a, b in sides)


def entrances_m(doors: Sequence[HingedDoor], room: Room) -> F64:
    """The middles (n, 2) of doors that lead out of the room."""
    out = [(door.from_m + door.to_m) / 2 for door in doors if in_outer_wall(door, room)]
    return np.array(out).reshape(-1, 2)


def blocks_of(door: HingedDoor, room: Room, *, is_open: bool) -> tuple[Block, ...]:
    """What the door puts into the room."""
    outer = in_outer_wall(door, room)
    if outer and not is_open:
        return ()
    leaves = tuple(
        _upright(f"{door.name} leaf {k}", door, hinge, tip)
        for k, (hinge, tip) in enumerate(leaf_ends(door, is_open=is_open), 1)
    )
    return (*leaves, _doorway(door, room)) if outer else leaves


def _upright(name: str, door: HingedDoor, a: F64, b: F64) -> Block:
    length_m, turn_rad = float(np.linalg.norm(b - a)), float(np.arctan2(*(b - a)[::-1]))
    size_m = np.array([length_m, THICK_M, door.height_m])
    return Block(name, door.surface, (a + b) / 2, size_m, turn_rad, clutter_per_m2=0.0)


def _doorway(door: HingedDoor, room: Room) -> Block:
    along = (door.to_m - door.from_m) / np.linalg.norm(door.to_m - door.from_m)
    aside = DEEP_M / 2 * np.array([-along[1], along[0]])
    before = _upright(f"{door.name} way", door, door.from_m + aside, door.to_m + aside)
    if not room.holds(before.centre_m[None])[0]:
        before = replace(before, centre_m=before.centre_m - 2 * aside)
    return replace(before, surface=DOORWAY, size_m=before.size_m * [1, DEEP_M / THICK_M, 1])


def leads_through(way_m: F64, door: HingedDoor) -> bool:
    """Whether somebody on this way (n, 2) passes the door."""
    return any(
        segment_gap_m(a, b, door.from_m, door.to_m) < HALF_WIDTH_M - TOUCH_M
        for a, b in pairwise(way_m)
    )


def with_doors(room: Room, doors: Sequence[HingedDoor], ways_m: Sequence[F64], day: int) -> Room:
    """The room with its doors as that day has them: open wherever one of the ways leads through."""

    def is_open(door: HingedDoor) -> bool:
        seed = [room.seed, day, 3, zlib.crc32(door.name.encode())]
        drawn = np.random.default_rng(seed).uniform() < OPEN_SHARE
        return drawn or any(leads_through(way_m, door) for way_m in ways_m)

    added = [block for door in doors for block in blocks_of(door, room, is_open=is_open(door))]
    return replace(room, blocks=(*room.blocks, *added)) if added else room


def room_to_walk_in(room: Room, doors: Sequence[HingedDoor], ways_m: Sequence[F64]) -> Room:
    """The room with all that its doors put in anybody's way, on whatever day."""
    added: list[Block] = []
    for door in doors:
        added += blocks_of(door, room, is_open=True)
        if not any(leads_through(way_m, door) for way_m in ways_m):
            added += blocks_of(door, room, is_open=False)
    return replace(room, blocks=(*room.blocks, *added)) if added else room

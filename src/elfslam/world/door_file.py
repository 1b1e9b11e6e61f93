"""The doors of a world file: `[[door]]` tables, and why some cannot hang where they are told to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.world.doors import HingedDoor, in_outer_wall, leaf_ends
from elfslam.world.room import Block, Room
from elfslam.world.room_file import material_of, repeats
from elfslam.world.toml_tables import (
    MOST_ITEMS,
    Table,
    check_keys,
    number,
    tables,
    text,
    vector,
    whole,
)
from elfslam.world.walkable import point_gap_m

DOOR_KEYS = (
    "name", "from_m", "to_m", "leaves", "open_deg", "height_m", "material", "repeat", "spacing_m",
)  # fmt: skip
HEIGHT_M = 2.1
LEAF_M = (0.4, 2.0)
"""How wide leaves are."""
HANGS_M = 0.15
"""From a wall or a piece of furniture, at both ends, at most."""
PROBES = 24


def read_doors(top: Table, room: Room) -> tuple[HingedDoor, ...]:
    """The doors of a room. Raises InputError that names the line and the element."""
    doors: list[HingedDoor] = []
    taken = {block.name for block in room.blocks}
    for given in tables(top, "door"):
        check_keys(given, DOOR_KEYS)
        made = _door(given, room)
        for suffix, shift in repeats(given):
            door = replace(
                made, name=made.name + suffix, from_m=made.from_m + shift, to_m=made.to_m + shift
            )
            if door.name in taken:
                raise given.refusal(
                    f"the name {door.name!r} is taken; give each piece its own", "name"
                )
            if len(doors) == MOST_ITEMS:
                raise given.refusal(f"more than {MOST_ITEMS} doors; take some out")
            taken.add(door.name)
            if complaint := _fault(door, room):
                raise given.refusal(f"{door.name!r} {complaint}", "from_m")
            doors.append(door)
    return tuple(doors)


def _door(given: Table, room: Room) -> HingedDoor:
    door = HingedDoor(
        text(given, "name"),
        material_of(given, "material", given.values.get("material", "door")),
        vector(given, "from_m", 2),
        vector(given, "to_m", 2),
        number(given, "height_m", min(HEIGHT_M, room.height_m), low=LEAF_M[0], high=room.height_m),
        np.deg2rad(number(given, "open_deg", 90.0, low=-180.0, high=180.0)),
        whole(given, "leaves", 1, low=1, high=2),
    )
    width_m = float(np.linalg.norm(door.to_m - door.from_m)) / door.leaves
    if not LEAF_M[0] <= width_m <= LEAF_M[1]:
        raise given.refusal(
            f"its leaf is {width_m:.2f} m wide, wanted {LEAF_M[0]:g} to {LEAF_M[1]:g}; move an end "
            "or give it two leaves", "to_m",
        )  # fmt: skip
    return door


def _fault(door: HingedDoor, room: Room) -> str | None:
    """Why the door cannot hang there, or None."""
    for end_m in (door.from_m, door.to_m):
        if _gap_m(room, end_m) > HANGS_M:
            return (
                f"ends at {end_m.tolist()}, {HANGS_M} m or more from any wall or piece; move that "
                "end to one"
            )
    if not in_outer_wall(door, room):
        for hinge, tip in leaf_ends(door, is_open=False):
            if met := _met(room, door, hinge, tip):
                return f"hangs in {met}, which has no opening there; move it into one"
    for hinge, tip in leaf_ends(door, is_open=True):
        if met := _met(room, door, hinge, tip):
            return f"opens into {met}; turn it the other way or less far (open_deg)"
    return None


def _gap_m(room: Room, end_m: F64) -> float:
    """How far a point is from the nearest wall or block; 0 within a block."""
    rings = [room.outline_m, *[block.corners_m for block in room.blocks]]
    sides = [(a, b) for ring in rings for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
    return min(float(point_gap_m(end_m[None], a, b)[0]) for a, b in sides)


def _met(room: Room, door: HingedDoor, hinge: F64, tip: F64) -> str | None:
    """What a leaf meets between its hinge and its far end: a wall, a block, or nothing."""
    xy_m = hinge + np.linspace(0.15, 0.97, PROBES)[:, None] * (tip - hinge)
    if not room.holds(xy_m).all():
        return "a wall"
    return next((f'"{block.name}"' for block in room.blocks if _holds(block, door, xy_m)), None)


def _holds(block: Block, door: HingedDoor, xy_m: F64) -> bool:
    local = np.abs(block.turn_back(xy_m - block.centre_m))
    return block.base_m < door.height_m and bool((local < block.size_m[:2] / 2).all(axis=1).any())

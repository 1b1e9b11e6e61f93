"""The room of a world file: outline, surfaces, furniture, partitions, doors and states."""

import difflib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.base.grid import in_ring, signed_area
from elfslam.world.doors import HingedDoor, in_outer_wall, leaf_ends
from elfslam.world.materials import Material, material
from elfslam.world.room import (
    CLUTTER_PER_M2,
    Block,
    Room,
    box,
    check_outline,
    point_gap_m,
    segments_cross,
    shoebox,
)
from elfslam.world.toml_tables import (
    LARGEST_M,
    MOST_ITEMS,
    Table,
    check_keys,
    inline,
    number,
    points,
    rows,
    table,
    tables,
    text,
    vector,
    whole,
)

SHORTEST_M = 0.01
LOWEST_CEILING_M = 2.0
SMALLEST_M2 = 1.0
MOST_CORNERS = 200
SLACK_M = 0.001
"""Furniture that touches a wall stands inside."""
ROOM_KEYS = (
    "size_m", "outline_m", "height_m", "reflection", "surfaces", "seed", "furniture_seed",
    "furniture", "partition", "state",
)  # fmt: skip
BLOCK_KEYS = ("name", "material", "repeat", "spacing_m")
FURNITURE_KEYS = ("corner_m", "size_m", "turn_deg", "clutter_per_m2", *BLOCK_KEYS)
PARTITION_KEYS = ("from_m", "to_m", "height_m", "thickness_m", *BLOCK_KEYS)
GIVEN = "given in the world file"


def read_room(top: Table) -> Room:
    """The room as it stands. Raises InputError that names the line and the element."""
    seed = _seed(top)
    if ("size_m" in top.values) == ("outline_m" in top.values):
        raise top.refusal("wanted either size_m or outline_m with height_m; give one of them")
    if "size_m" in top.values:
        size_m = vector(top, "size_m", 3, low=SHORTEST_M, high=LARGEST_M)
        _check_ceiling(top, "size_m", float(size_m[2]))
        room = shoebox(size_m, _surfaces(top, 4), seed=seed)
    else:
        room = _polygon(top, seed)
    return replace(room, blocks=_blocks(top, room))


def read_states(top: Table, room: Room) -> Mapping[str, Room]:
    """The room with its furniture moved, by the name of each `[[state]]`."""
    states: dict[str, Room] = {}
    for state in tables(top, "state"):
        check_keys(state, ("name", "moved", "removed"))
        name = text(state, "name")
        if name in states:
            raise state.refusal(f"the name {name!r} is taken; give each state its own", "name")
        states[name] = _state(state, room)
    return MappingProxyType(states)


def _seed(top: Table) -> int:
    if "seed" in top.values and "furniture_seed" in top.values:
        raise top.refusal("furniture_seed is the older name of seed; drop it", "furniture_seed")
    key = "furniture_seed" if "furniture_seed" in top.values else "seed"
    return whole(top, key, low=0, high=2**32 - 1)


def _check_ceiling(top: Table, key: str, height_m: float) -> None:
    if height_m < LOWEST_CEILING_M:
        raise top.refusal(
            f"the ceiling is {height_m:g} m high, wanted {LOWEST_CEILING_M:g} m or more; raise it",
            key,
        )


def _polygon(top: Table, seed: int) -> Room:
    """The corners counter-clockwise; materials stay with their sides."""
    given = points(top, "outline_m", top.values["outline_m"], MOST_CORNERS)
    height_m = number(top, "height_m", low=SHORTEST_M)
    _check_ceiling(top, "height_m", height_m)
    try:
        outline = check_outline(given)
    except InputError as cause:
        raise top.refusal(f"outline_m: {cause}", "outline_m") from cause
    _check_area(top, outline)
    *walls, floor, ceiling = _surfaces(top, len(given))
    if outline is not given and (outline != given).any():
        walls = [walls[len(walls) - 2 - k] for k in range(len(walls))]
    return Room(outline, height_m, tuple(walls), floor, ceiling, (), seed)


def _check_area(top: Table, outline_m: F64) -> None:
    area_m2 = signed_area(outline_m)
    if area_m2 < SMALLEST_M2:
        raise top.refusal(
            f"outline_m: encloses {area_m2:g} m2, wanted {SMALLEST_M2:g} or more; move corners",
            "outline_m",
        )


def _surfaces(top: Table, sides: int) -> tuple[Material, ...]:
    if ("reflection" in top.values) == ("surfaces" in top.values):
        raise top.refusal("wanted either [surfaces] or reflection; give one of them", "reflection")
    if "reflection" in top.values:
        given = vector(top, "reflection", sides + 2, low=0.0, high=1.0)
        return tuple(
            Material(f"reflection {value:g}", 1 - value**2, 0.0, GIVEN) for value in given.tolist()
        )
    surfaces = table(top, "surfaces")
    check_keys(surfaces, ("walls", "floor", "ceiling"))
    walls = surfaces.values.get("walls")
    each = walls if isinstance(walls, list) else [walls] * sides
    if len(each) != sides:
        raise surfaces.refusal(
            f"walls has {len(each)} materials, wanted one or {sides}; add or drop some", "walls"
        )
    made = [material_of(surfaces, "walls", wall) for wall in each]
    ends = [material_of(surfaces, key, surfaces.values.get(key)) for key in ("floor", "ceiling")]
    return (*made, *ends)


def material_of(given: Table, key: str, value: object) -> Material:
    """A material by its name, or one that a table in braces describes."""
    if isinstance(value, dict):
        described = inline(given, key, value, key)
        check_keys(described, ("name", "absorption", "scattering"))
        absorption = number(described, "absorption", low=0.0, high=1.0)
        scattering = number(described, "scattering", 0.0, low=0.0, high=1.0)
        name = text(described, "name", f"absorption {absorption:g}")
        return Material(name, absorption, scattering, GIVEN)
    if not isinstance(value, str):
        raise given.refusal(f"{key} is {value!r:.40}, wanted the name of a material", key)
    try:
        return material(value)
    except InputError as cause:
        raise given.refusal(f"{key}: {cause}", key) from cause


def _blocks(top: Table, room: Room) -> tuple[Block, ...]:
    blocks: dict[str, Block] = {}
    for given, made in (*_furniture(top), *_partitions(top, room.height_m)):
        for suffix, shift in repeats(given):
            block = replace(made, name=made.name + suffix, centre_m=made.centre_m + shift)
            if block.name in blocks:
                raise given.refusal(
                    f"the name {block.name!r} is taken; give each piece its own", "name"
                )
            if len(blocks) == MOST_ITEMS:
                raise given.refusal(f"more than {MOST_ITEMS} pieces of furniture; take some out")
            _check_inside(given, room, block)
            blocks[block.name] = block
    return tuple(blocks.values())


def _furniture(top: Table) -> Iterator[tuple[Table, Block]]:
    for given in tables(top, "furniture"):
        check_keys(given, FURNITURE_KEYS)
        block = box(
            text(given, "name"),
            vector(given, "corner_m", 3),
            vector(given, "size_m", 3, low=SHORTEST_M),
            material_of(given, "material", given.values.get("material", "wood panel")),
            np.deg2rad(number(given, "turn_deg", 0.0, low=-360.0, high=360.0)),
            number(given, "clutter_per_m2", CLUTTER_PER_M2, low=0.0, high=100.0),
        )
        yield given, block


def _partitions(top: Table, ceiling_m: float) -> Iterator[tuple[Table, Block]]:
    for given in tables(top, "partition"):
        check_keys(given, PARTITION_KEYS)
        start, end = vector(given, "from_m", 2), vector(given, "to_m", 2)
        thickness_m = number(given, "thickness_m", 0.1, low=SHORTEST_M, high=5.0)
        height_m = number(given, "height_m", ceiling_m, low=SHORTEST_M)
        length_m = float(np.linalg.norm(end - start))
        if length_m < SHORTEST_M:
            raise given.refusal("begins where it ends; move one end", "to_m")
        yield (
            given,
            Block(
                text(given, "name"),
                material_of(given, "material", given.values.get("material", "gypsum board")),
                (start + end) / 2,
                np.array([length_m, thickness_m, height_m]),
                float(np.arctan2(*(end - start)[::-1])),
                clutter_per_m2=0.0,
            ),
        )


def repeats(given: Table) -> Iterator[tuple[str, F64]]:
    """What names end in and places are shifted by (2), for rows of the same along x first."""
    if "repeat" not in given.values and "spacing_m" not in given.values:
        yield "", np.zeros(2)
        return
    counts = vector(given, "repeat", 2, low=1, high=200)
    if (counts % 1 != 0).any():
        raise given.refusal(f"repeat is {counts.tolist()}, wanted whole numbers", "repeat")
    step = vector(given, "spacing_m", 2)
    along, across = int(counts[0]), int(counts[1])
    for k in range(along * across):
        yield f" {k + 1}", step * [k % along, k // along]


def _check_inside(given: Table, room: Room, block: Block, key: str = "corner_m") -> None:
    """A partition may end in a wall: its middle line counts."""
    if block.base_m < 0 or block.top_m > room.height_m + SLACK_M:
        raise given.refusal(
            f"{block.name!r} reaches from {block.base_m:g} to {block.top_m:g} m, wanted 0 to the "
            f"ceiling at {room.height_m:g} m; lower it", key,
        )  # fmt: skip
    thin = block.clutter_per_m2 == 0 and "from_m" in given.values
    size_m = block.size_m * [1, 0, 1] if thin else block.size_m
    corners = replace(block, size_m=np.maximum(size_m - 2 * SLACK_M, 0.0)).corners_m
    ends = np.roll(corners, -1, axis=0)
    walls = list(zip(room.outline_m, np.roll(room.outline_m, -1, axis=0), strict=True))
    crossing = any(
        segments_cross(a, b, c, d) for a, b in zip(corners, ends, strict=True) for c, d in walls
    )
    if crossing or not in_ring(room.outline_m, corners).all():
        raise given.refusal(f"{block.name!r} stands outside the room; move or shorten it", key)


def _state(state: Table, room: Room) -> Room:
    blocks = {block.name: block for block in room.blocks}
    removed = rows(state, "removed")
    for name in removed:
        _check_known(state, "removed", name, blocks)
    moved: dict[str, Block] = {}
    for k, value in enumerate(rows(state, "moved"), 1):
        move = inline(state, "moved", value, f"moved {k}")
        check_keys(move, ("name", "by_m", "turn_deg"))
        name = text(move, "name")
        _check_known(state, "moved", name, blocks)
        if name in moved or name in removed:
            raise move.refusal(f"{name!r} is moved or removed before; name it once")
        moved[name] = _moved(move, blocks[name])
        _check_inside(move, room, moved[name], "moved")
    if not moved and not removed:
        raise state.refusal("neither moves nor removes anything; add moved or removed")
    kept = [moved.get(block.name, block) for block in room.blocks if block.name not in removed]
    return replace(room, blocks=tuple(kept))


def _moved(move: Table, block: Block) -> Block:
    turn_rad = np.deg2rad(number(move, "turn_deg", 0.0, low=-360.0, high=360.0))
    by_m = vector(move, "by_m", 2, (0.0, 0.0))
    return replace(block, centre_m=block.centre_m + by_m, turn_rad=block.turn_rad + turn_rad)


def _check_known(state: Table, key: str, name: object, blocks: Mapping[str, Block]) -> None:
    if not isinstance(name, str) or name not in blocks:
        near = difflib.get_close_matches(str(name), blocks, n=1)
        advice = f"did you mean {near[0]!r}?" if near else "name a piece of furniture"
        raise state.refusal(f"{key}: there is no {name!r:.60}; {advice}", key)


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
    return next(
        (f'"{block.name}"' for block in room.blocks if _blocks_leaf(block, door, xy_m)), None
    )


def _blocks_leaf(block: Block, door: HingedDoor, xy_m: F64) -> bool:
    local = np.abs(block.turn_back(xy_m - block.centre_m))
    return block.base_m < door.height_m and bool((local < block.size_m[:2] / 2).all(axis=1).any())

"""Rooms: a polygon between floor and ceiling with solid blocks in it, and where people can walk."""

import math
from dataclasses import dataclass, field

import numpy as np

from elfslam.base.arrays import F64, Bool, Value, array
from elfslam.base.errors import InputError
from elfslam.base.grid import in_ring, signed_area
from elfslam.world.materials import Material, material

CLUTTER_PER_M2 = 4.0
"""Points per square metre of furniture surface: edges, handles, books, folds."""
TOUCH_M = 1e-6


@dataclass(frozen=True, eq=False)
class Block(Value):
    """A solid box, turned about the vertical: furniture, a partition, a pillar, a closed store.

    `size_m` is length, width and height; the underside is `base_m` above the floor. Walls with
    `clutter_per_m2` 0 are plain; others carry scatterers that move with the block.
    """

    name: str
    surface: Material
    centre_m: F64 = array(2)
    size_m: F64 = array(3)
    turn_rad: float = 0.0
    base_m: float = 0.0
    clutter_per_m2: float = CLUTTER_PER_M2

    @property
    def corners_m(self) -> F64:
        """Corners in plan (4, 2), counter-clockwise."""
        half = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * self.size_m[:2]
        return self.place(np.column_stack([half, np.zeros(4)]))[:, :2]

    @property
    def top_m(self) -> float:
        """Height of the top above the floor."""
        return self.base_m + float(self.size_m[2])

    def place(self, local_m: F64) -> F64:
        """Points (n, 3) of the block's own frame (origin amid its underside) in the room."""
        planar = self.turn(local_m[:, :2]) + self.centre_m
        return np.column_stack([planar, local_m[:, 2] + self.base_m])

    def turn(self, vectors: F64) -> F64:
        """Plan vectors (n, 2) of the block's frame in the room's."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.asarray(vectors @ np.array([[cos, sin], [-sin, cos]]))

    def turn_back(self, vectors: F64) -> F64:
        """Plan vectors (n, 2) of the room in the block's frame."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        return np.asarray(vectors @ np.array([[cos, -sin], [sin, cos]]))


@dataclass(frozen=True, eq=False)
class Room(Value):
    """A simple polygon, counter-clockwise, from the floor at 0 to a flat ceiling.

    `walls` has one material per side, from corner k to corner k + 1. `seed` draws the clutter.
    """

    outline_m: F64 = field(metadata=array("w", 2).metadata)
    height_m: float
    walls: tuple[Material, ...]
    floor: Material
    ceiling: Material
    blocks: tuple[Block, ...] = ()
    seed: int = 0

    @property
    def size_m(self) -> F64:
        """Length, width and height of the box about the room (3)."""
        return np.append(np.ptp(self.outline_m, axis=0), self.height_m)

    @property
    def corner_m(self) -> F64:
        """Lower left corner of the box about the room (2)."""
        return np.asarray(self.outline_m.min(axis=0))

    def holds(self, xy_m: F64) -> Bool:
        """Whether each point (n, 2) lies inside the outline."""
        return in_ring(self.outline_m, xy_m)

    def is_free(self, xy_m: F64, height_m: float, margin_m: float = 0.0) -> Bool:
        """Whether a phone at `height_m` above each point (n, 2) is in the room and in no block."""
        free = self.holds(xy_m)
        for block in self.blocks:
            if block.base_m < height_m < block.top_m:
                free &= ~_in_block(block, xy_m, margin_m)
        if margin_m:
            free &= _wall_distance_m(self.outline_m, xy_m) >= margin_m
        return free


def shoebox(
    size_m: F64, surfaces: tuple[Material, ...], blocks: tuple[Block, ...] = (), seed: int = 0
) -> Room:
    """A rectangle from the origin on; surfaces: x=0, x=L, y=0, y=W, floor, ceiling."""
    length, width, height = (float(value) for value in size_m)
    west, east, south, north, floor, ceiling = surfaces
    outline = np.array([[0, 0], [length, 0], [length, width], [0, width]], dtype=np.float64)
    return Room(outline, height, (south, east, north, west), floor, ceiling, blocks, seed)


def floor_area_m2(room: Room) -> float:
    """The area of the floor, furniture included."""
    return abs(signed_area(room.outline_m))


def check_outline(outline_m: F64) -> F64:
    """The same corners counter-clockwise.

    Raises InputError for fewer than three corners, equal neighbours and sides that cross.
    """
    if len(outline_m) < 3:
        raise InputError(f"wanted at least 3 corners, got {len(outline_m)}; add some")
    following = np.roll(outline_m, -1, axis=0)
    short = np.flatnonzero(np.linalg.norm(following - outline_m, axis=1) < 0.01)
    if len(short):
        raise InputError(
            f"corners {short[0] + 1} and {(short[0] + 1) % len(outline_m) + 1} are one place "
            f"{outline_m[short[0]].tolist()}; drop one (the outline closes by itself)"
        )
    _refuse_crossing(outline_m, following)
    return outline_m if signed_area(outline_m) > 0 else outline_m[::-1]


def _refuse_crossing(a: F64, b: F64) -> None:
    count = len(a)
    for i in range(count):
        for j in range(i + 1, count):
            neighbours = j == i + 1 or (i == 0 and j == count - 1)
            if not neighbours and segments_cross(a[i], b[i], a[j], b[j]):
                raise InputError(
                    f"side {i + 1} from {a[i].tolist()} to {b[i].tolist()} crosses side {j + 1} "
                    f"from {a[j].tolist()} to {b[j].tolist()}; reorder the corners"
                )


def segments_cross(a: F64, b: F64, c: F64, d: F64) -> bool:
    """Whether segments ab and cd share a point."""
    sides = [
        float(_cross(b - a, c - a)), float(_cross(b - a, d - a)),
        float(_cross(d - c, a - c)), float(_cross(d - c, b - c)),
    ]  # fmt: skip
    apart = (np.maximum(a, b) < np.minimum(c, d)) | (np.maximum(c, d) < np.minimum(a, b))
    return bool(sides[0] * sides[1] <= 0 and sides[2] * sides[3] <= 0 and not apart.any())


def _cross(a: F64, b: F64) -> F64:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _in_block(block: Block, xy_m: F64, margin_m: float) -> Bool:
    local = block.turn_back(xy_m - block.centre_m)
    return np.asarray((np.abs(local) < block.size_m[:2] / 2 + margin_m - TOUCH_M).all(axis=1))


def _wall_distance_m(outline_m: F64, xy_m: F64) -> F64:
    a, along = outline_m, np.roll(outline_m, -1, axis=0) - outline_m
    share = ((xy_m[:, None, :] - a) * along).sum(axis=2) / (along**2).sum(axis=1)
    nearest = a + np.clip(share, 0.0, 1.0)[:, :, None] * along
    return np.asarray(np.linalg.norm(xy_m[:, None, :] - nearest, axis=2).min(axis=1))


def box(
    name: str,
    corner_m: F64,
    size_m: F64,
    surface: Material | None = None,
    turn_rad: float = 0.0,
    clutter_per_m2: float = CLUTTER_PER_M2,
) -> Block:
    """A block by its low corner (x, y, base) before it is turned about its middle."""
    corner, size = np.asarray(corner_m, dtype=np.float64), np.asarray(size_m, dtype=np.float64)
    return Block(
        name,
        surface or material("wood panel"),
        corner[:2] + size[:2] / 2,
        size,
        turn_rad,
        float(corner[2]),
        clutter_per_m2,
    )


HALF_WIDTH_M = 0.25
"""Of a person, to either side."""
HEAD_M = 1.8
"""What hangs higher than this is no obstacle."""
SHORTEST_ROUTE_M = 2.0


def standing_room(room: Room, xy_m: F64) -> Bool:
    """Whether a person can stand at each point (n, 2)."""
    ends = np.roll(room.outline_m, -1, axis=0)
    walls_m = [point_gap_m(xy_m, a, b) for a, b in zip(room.outline_m, ends, strict=True)]
    free = room.holds(xy_m) & (np.min(walls_m, axis=0) >= HALF_WIDTH_M - TOUCH_M)
    for block in _low_blocks(room):
        free &= (np.abs(_in_frame_of(block, xy_m)) >= _half_m(block)).any(axis=1)
    return np.asarray(free)


def in_the_way(room: Room, a: F64, b: F64) -> str | None:
    """What a person meets on the way from a to b (2): a wall, a block, or nothing."""
    if not room.holds(np.stack([a, b])).all():
        return "the outside of the room"
    ends = np.roll(room.outline_m, -1, axis=0)
    for k, (c, d) in enumerate(zip(room.outline_m, ends, strict=True), 1):
        if segment_gap_m(a, b, c, d) < HALF_WIDTH_M - TOUCH_M:
            return f"the wall from {c.tolist()} to {d.tolist()} (side {k})"
    for block in _near_blocks(room, a, b):
        if meets_block(block, a[None, :], b[None, :])[0]:
            return f'"{block.name}"'
    return None


def _near_blocks(room: Room, a: F64, b: F64) -> list[Block]:
    """The low blocks whose corners are far enough out to be met on the way from a to b (2)."""
    low = _low_blocks(room)
    if not low:
        return []
    gaps_m = point_gap_m(np.array([block.centre_m for block in low]), a, b).tolist()
    return [
        block
        for block, gap_m in zip(low, gaps_m, strict=True)
        if gap_m < math.hypot(*_half_m(block)) + TOUCH_M
    ]


def fault_of_route(room: Room, route_m: F64, *, closed: bool) -> str | None:
    """Why nobody can walk along these corners (n, 2), or None."""
    legs = [(route_m[k], route_m[k + 1]) for k in range(len(route_m) - 1)]
    if closed and len(route_m) > 1:
        legs.append((route_m[-1], route_m[0]))
    if len(np.unique(route_m, axis=0)) < 2:
        return "has fewer than 2 distinct corners; add some"
    length_m = sum(float(np.linalg.norm(b - a)) for a, b in legs)
    if length_m < SHORTEST_ROUTE_M:
        return f"is {length_m:.2f} m long, wanted {SHORTEST_ROUTE_M:g} m or more; lengthen it"
    for k, (a, b) in enumerate(legs, 1):
        met = in_the_way(room, a, b)
        if met:
            last = " (the one that closes it)" if closed and k == len(legs) else ""
            return (
                f"leg {k}{last} from {a.tolist()} to {b.tolist()} meets {met}; "
                f"keep {HALF_WIDTH_M} m off"
            )
    return None


def meets_block(block: Block, a: F64, b: F64) -> Bool:
    """Whether a person who walks from each a to each b (n, 2) touches the block."""
    p, q = _in_frame_of(block, a), _in_frame_of(block, b)
    half = _half_m(block)
    way = q - p
    still = way == 0
    step = np.where(still, 1.0, way)
    ends = np.stack([(-half - p) / step, (half - p) / step])
    always = np.where(np.abs(p) < half, -np.inf, np.inf)
    enter = np.where(still, always, ends.min(axis=0)).max(axis=1)
    leave = np.where(still, -always, ends.max(axis=0)).min(axis=1)
    return np.asarray(np.maximum(enter, 0.0) < np.minimum(leave, 1.0))


def segment_gap_m(a: F64, b: F64, c: F64, d: F64) -> float:
    """Distance between the segments ab and cd."""
    if segments_cross(a, b, c, d):
        return 0.0
    there, back = point_gap_m(np.stack([a, b]), c, d), point_gap_m(np.stack([c, d]), a, b)
    return float(min(there.min(), back.min()))


def point_gap_m(xy_m: F64, a: F64, b: F64) -> F64:
    """Distance of points (n, 2) from the segment ab."""
    along = b - a
    share = (xy_m - a) @ along / max(float(along @ along), TOUCH_M**2)
    nearest = a + np.clip(share, 0.0, 1.0)[:, None] * along
    return np.asarray(np.linalg.norm(xy_m - nearest, axis=1))


def _low_blocks(room: Room) -> list[Block]:
    return [block for block in room.blocks if block.base_m < HEAD_M]


def _half_m(block: Block) -> F64:
    """Half the sides (2) of the ground that nobody's middle can be over."""
    return block.size_m[:2] / 2 + HALF_WIDTH_M - TOUCH_M


def _in_frame_of(block: Block, xy_m: F64) -> F64:
    cos, sin = np.cos(block.turn_rad), np.sin(block.turn_rad)
    return np.asarray((xy_m - block.centre_m) @ np.array([[cos, -sin], [sin, cos]]))

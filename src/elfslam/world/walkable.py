"""Where a person can stand and walk: off walls, partitions and furniture."""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64, Bool
from elfslam.world.room import TOUCH_M, Block, Room, segments_cross

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
    for block in _low_blocks(room):
        if meets_block(block, a[None, :], b[None, :])[0]:
            return f'"{block.name}"'
    return None


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

"""Random rooms for pre-training: of every size, shape, material and amount of furniture.

They have a generator of their own and share nothing with the built-in worlds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elfslam.base.arrays import F64
from elfslam.base.grid import in_ring
from elfslam.world.materials import Material
from elfslam.world.room import Block, Room, box, shoebox

CORRIDOR_SHARE = 0.25
"""Share of the rooms that are much longer than wide."""
CORNER_SHARE = 0.3
"""Share of the rooms that have a corner cut out: an L, whose outline is no longer convex."""
LEANING_SHARE = 0.2
"""Share of the rooms with walls out of square."""
HIGH_FROM_M2 = 150.0
"""Rooms from this size on may be halls, with a ceiling up to 6 m high."""
MOST_FURNITURE = 48
MOST_PARTITIONS = 8
PILLAR_SHARE = 0.12
"""Share of the furniture that reaches up to the ceiling."""

NEW_SURFACE_SHARE = 0.4
"""Share of the walls that are of another material in a changed room."""
GONE_SHARE = 0.15
MOVED_SHARE = 0.3
"""Shares of the furniture that is gone and moved in a changed room."""
MOVED_M = 0.5
MOVED_RAD = 0.3


def random_room(generator: np.random.Generator) -> Room:
    """A room, corridor or hall of 4 to 1600 m2 with random walls, partitions and furniture."""
    size_m = _random_size(generator)
    level, scattering = generator.uniform(0.6, 0.97), generator.uniform(0.0, 0.2)
    sides = [_surface(generator, level, scattering) for _ in range(6)]
    room = shoebox(size_m, tuple(sides), seed=int(generator.integers(2**31)))
    outline = _random_outline(generator, room.outline_m)
    walls = tuple(_surface(generator, level, scattering) for _ in outline)
    blocks = _random_blocks(generator, size_m)
    blocks = tuple(block for block in blocks if in_ring(outline, block.corners_m).all())
    return Room(outline, room.height_m, walls, sides[4], sides[5], blocks, room.seed)


def changed_room(generator: np.random.Generator, room: Room) -> Room:
    """The room another time: some walls of other materials, some furniture moved or gone."""

    def surface(before: Material) -> Material:
        if generator.uniform() > NEW_SURFACE_SHARE:
            return before
        return _surface(generator, generator.uniform(0.35, 0.95), generator.uniform(0.0, 0.2))

    blocks = [_changed_block(generator, room, block) for block in room.blocks]
    return replace(
        room,
        walls=tuple(surface(wall) for wall in room.walls),
        floor=surface(room.floor),
        ceiling=surface(room.ceiling),
        blocks=tuple(block for block in blocks if block),
    )


def _changed_block(generator: np.random.Generator, room: Room, block: Block) -> Block | None:
    fate, shift = generator.uniform(), generator.normal(0, MOVED_M, 2)
    turn_rad = generator.normal(0, MOVED_RAD)
    if block.clutter_per_m2 == 0 or fate > GONE_SHARE + MOVED_SHARE:
        return block
    if fate < GONE_SHARE:
        return None
    centre_m, turned_rad = block.centre_m + shift, block.turn_rad + turn_rad
    moved = replace(block, centre_m=centre_m, turn_rad=turned_rad)
    return moved if room.holds(moved.corners_m).all() else block


def _random_size(generator: np.random.Generator) -> F64:
    if generator.uniform() < CORRIDOR_SHARE:
        width = np.exp(generator.uniform(np.log(1.8), np.log(9.0)))
        plan = np.array([width * generator.uniform(3.0, 12.0), width])
    else:
        area_m2 = np.exp(generator.uniform(np.log(9.0), np.log(1600.0)))
        aspect = generator.uniform(1.0, 2.2)
        plan = np.sqrt([area_m2 * aspect, area_m2 / aspect])
    low, high = (2.3, 3.6) if plan.prod() < HIGH_FROM_M2 else (2.5, 6.0)
    return np.append(plan, generator.uniform(low, high))


def _surface(generator: np.random.Generator, level: float, scattering: float) -> Material:
    reflection = float(np.clip(level + generator.uniform(-0.15, 0.15), 0.3, 0.98))
    return Material("random", 1.0 - reflection**2, scattering, "drawn at random")


def _random_outline(generator: np.random.Generator, rectangle_m: F64) -> F64:
    kind, outline = generator.uniform(), rectangle_m
    size = np.ptp(rectangle_m, axis=0)
    if kind < CORNER_SHARE:
        cut = size * (1.0 - generator.uniform(0.2, 0.55, 2))
        notch = [[size[0], cut[1]], cut, [cut[0], size[1]]]
        outline = np.vstack([rectangle_m[:2], notch, rectangle_m[3:]])
    elif kind < CORNER_SHARE + LEANING_SHARE:
        outline = rectangle_m + generator.uniform(0.0, 0.12, (4, 2)) * (size / 2 - rectangle_m)
    return outline


def _random_blocks(generator: np.random.Generator, size_m: F64) -> tuple[Block, ...]:
    area_m2 = float(size_m[:2].prod())
    count = min(int(generator.integers(2, 4 + max(round(area_m2 * 0.25), 1))), MOST_FURNITURE)
    walls = int(generator.integers(0, 1 + min(int(area_m2 // 15), MOST_PARTITIONS)))
    furniture = [_random_furniture(generator, size_m, k) for k in range(count)]
    return (*furniture, *[_random_partition(generator, size_m, k) for k in range(walls)])


def _random_furniture(generator: np.random.Generator, size_m: F64, k: int) -> Block:
    """A thing on the floor, at a wall in half of the cases; a pillar, or a board at 0.7 m."""
    size = generator.uniform([0.4, 0.3, 0.4], [2.2, 1.0, 2.0])
    pillar, lying = generator.uniform() < PILLAR_SHARE, generator.uniform() < 0.5
    size = np.minimum(size[[1, 0, 2]] if lying else size, [*(0.5 * size_m[:2]), size_m[2]])
    if pillar:
        size[2] = size_m[2]
    where = generator.uniform(0.0, 1.0, 2)
    if generator.uniform() < 0.5:
        where[generator.integers(2)] = generator.integers(2)
    corner = np.append(where * (size_m - size)[:2], 0.0)
    if not pillar and generator.uniform() < 0.2:
        corner[2], size[2] = 0.7, 0.05
    turn_rad = generator.uniform(-np.pi, np.pi) if generator.uniform() < 0.15 else 0.0
    surface = _surface(generator, generator.uniform(0.45, 0.95), generator.uniform(0.0, 0.6))
    return box(f"item {k}", corner, size, surface, turn_rad)


def _random_partition(generator: np.random.Generator, size_m: F64, k: int) -> Block:
    """A screen of 1.2 to 1.8 m or a wall up to the ceiling, along one of the axes."""
    full = generator.uniform() < 0.4
    high = size_m[2] if full else generator.uniform(1.2, 1.8)
    size = np.array([min(generator.uniform(1.0, 6.0), 0.6 * size_m[:2].min()), 0.08, high])
    if generator.uniform() < 0.5:
        size = size[[1, 0, 2]]
    corner = np.append(generator.uniform(0.05, 0.95, 2) * (size_m - size)[:2], 0.0)
    surface = _surface(generator, generator.uniform(0.45, 0.97), generator.uniform(0.0, 0.2))
    return box(f"partition {k}", corner, size, surface, clutter_per_m2=0.0)

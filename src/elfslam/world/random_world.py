"""Random rooms for pre-training: of every size, shape, material and amount of furniture.

They have a generator of their own and share nothing with the built-in worlds.
"""

from __future__ import annotations

import numpy as np

from elfslam.base.arrays import F64
from elfslam.world.materials import Material
from elfslam.world.room import Block, Room, box, inside, shoebox

CORNER_SHARE = 0.3
"""Share of the rooms that have a corner cut out: an L, whose outline is no longer convex."""
LEANING_SHARE = 0.2
"""Share of the rooms with walls out of square."""
MOST_FURNITURE = 24
MOST_PARTITIONS = 5


def random_room(generator: np.random.Generator) -> Room:
    """A room of 9 to 400 m2 with random walls, partitions and furniture, all of it inside."""
    area_m2 = float(np.exp(generator.uniform(np.log(9.0), np.log(400.0))))
    aspect = generator.uniform(1.0, 2.2)
    size_m = np.array(
        [np.sqrt(area_m2 * aspect), np.sqrt(area_m2 / aspect), generator.uniform(2.3, 3.6)]
    )
    level, scattering = generator.uniform(0.55, 0.95), generator.uniform(0.0, 0.15)
    sides = [_surface(generator, level, scattering) for _ in range(6)]
    room = shoebox(size_m, tuple(sides), seed=int(generator.integers(2**31)))
    outline = _random_outline(generator, room.outline_m)
    walls = tuple(_surface(generator, level, scattering) for _ in outline)
    blocks = _random_blocks(generator, size_m, area_m2)
    blocks = tuple(block for block in blocks if inside(outline, block.corners_m).all())
    return Room(outline, room.height_m, walls, sides[4], sides[5], blocks, room.seed)


def _surface(generator: np.random.Generator, level: float, scattering: float) -> Material:
    reflection = float(np.clip(level + generator.uniform(-0.15, 0.15), 0.3, 0.97))
    return Material("random", 1.0 - reflection**2, scattering, "drawn at random")


def _random_outline(generator: np.random.Generator, rectangle_m: F64) -> F64:
    """The rectangle, the rectangle less a corner, or one with walls out of square."""
    kind, outline = generator.uniform(), rectangle_m
    size = np.ptp(rectangle_m, axis=0)
    if kind < CORNER_SHARE:
        cut = size * (1.0 - generator.uniform(0.2, 0.55, 2))
        notch = [[size[0], cut[1]], cut, [cut[0], size[1]]]
        outline = np.vstack([rectangle_m[:2], notch, rectangle_m[3:]])
    elif kind < CORNER_SHARE + LEANING_SHARE:
        outline = rectangle_m + generator.uniform(0.0, 0.12, (4, 2)) * (size / 2 - rectangle_m)
    return outline


def _random_blocks(
    generator: np.random.Generator, size_m: F64, area_m2: float
) -> tuple[Block, ...]:
    count = min(int(generator.integers(2, 4 + max(round(area_m2 * 0.25), 1))), MOST_FURNITURE)
    walls = int(generator.integers(0, 1 + min(int(area_m2 // 15), MOST_PARTITIONS)))
    furniture = [_random_furniture(generator, size_m, k) for k in range(count)]
    return (*furniture, *[_random_partition(generator, size_m, k) for k in range(walls)])


def _random_furniture(generator: np.random.Generator, size_m: F64, k: int) -> Block:
    size = generator.uniform([0.4, 0.3, 0.4], [2.2, 1.0, 2.0])
    if generator.uniform() < 0.5:
        size = size[[1, 0, 2]]
    size = np.minimum(size, 0.6 * size_m)
    corner = np.append(generator.uniform(0.0, 1.0, 2) * (size_m - size)[:2], 0.0)
    if generator.uniform() < 0.2:
        corner[2], size[2] = 0.7, 0.05
    turn_rad = generator.uniform(-np.pi, np.pi) if generator.uniform() < 0.15 else 0.0
    surface = _surface(generator, generator.uniform(0.45, 0.9), generator.uniform(0.0, 0.3))
    return box(f"item {k}", corner, size, surface, turn_rad)


def _random_partition(generator: np.random.Generator, size_m: F64, k: int) -> Block:
    """A screen of 1.2 to 1.8 m or a wall up to the ceiling, along one of the axes."""
    full = generator.uniform() < 0.3
    high = size_m[2] if full else generator.uniform(1.2, 1.8)
    size = np.array([min(generator.uniform(1.0, 4.0), 0.6 * size_m.min()), 0.08, high])
    if generator.uniform() < 0.5:
        size = size[[1, 0, 2]]
    corner = np.append(generator.uniform(0.05, 0.95, 2) * (size_m - size)[:2], 0.0)
    surface = _surface(generator, generator.uniform(0.45, 0.9), generator.uniform(0.0, 0.2))
    return box(f"partition {k}", corner, size, surface, clutter_per_m2=0.0)

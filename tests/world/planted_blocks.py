"""Worlds that come along; a room with a table, a lamp above the floor, and blocks at random."""

from functools import cache

import numpy as np

from elfslam.world.materials import Material
from elfslam.world.room import Block, Room, box, shoebox
from elfslam.world.scene import Scene, scene_of
from elfslam.world.world_file import World, load_world

PLAIN = Material("plain", 0.3, 0.0, "planted")
NOBODY = np.zeros((0, 2))
TABLE = box("table", [2.0, 1.0, 0.0], [1.0, 2.0, 0.7], PLAIN, 0.0, 0.0)
LAMP = box("lamp", [4.0, 1.0, 1.8], [1.0, 2.0, 0.4], PLAIN, 0.0, 0.0)
ELL_M = np.array([[0, 0], [6, 0], [6, 3], [3, 3], [3, 5], [0, 5]], dtype=float)
"""An outline with a notch."""


@cache
def loaded(name: str) -> World:
    """A built-in world, which is read once."""
    return load_world(name)


def scene_with(*blocks: Block) -> Scene:
    return scene_of(shoebox(np.array([8.0, 6.0, 2.5]), (PLAIN,) * 6, blocks))


def scene_with_a_notch() -> Scene:
    return scene_of(Room(ELL_M, 2.5, (PLAIN,) * 6, PLAIN, PLAIN))


def random_blocks(generator: np.random.Generator, count: int) -> list[Block]:
    """Of any size below a metre or two, at any height."""
    return [
        Block(
            f"{k}", PLAIN, generator.uniform([0, 0], [8, 6]), generator.uniform(0.1, 2.0, 3),
            generator.uniform(0, 3), generator.uniform(0, 0.5), 0.0,
        )
        for k in range(count)
    ]  # fmt: skip

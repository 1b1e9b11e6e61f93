"""Lines of sight: over tables, below lamps, round corners, and as plain geometry has it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from elfslam.base.arrays import F64
from elfslam.world.materials import Material
from elfslam.world.plan import make_crossings, note_crossings
from elfslam.world.room import Block, Room, box, shoebox
from elfslam.world.scene import FEW_BLOCKS, Scene, scene_of
from elfslam.world.sight import hides, look, make_sight

PLAIN = Material("plain", 0.3, 0.0, "planted")
NOBODY = np.zeros((0, 2))
TABLE = box("table", [2.0, 1.0, 0.0], [1.0, 2.0, 0.7], PLAIN, 0.0, 0.0)
LAMP = box("lamp", [4.0, 1.0, 1.8], [1.0, 2.0, 0.4], PLAIN, 0.0, 0.0)


def scene_with(*blocks: Block) -> Scene:
    return scene_of(shoebox(np.array([8.0, 6.0, 2.5]), (PLAIN,) * 6, blocks))


def is_hidden(scene: Scene, a: F64, b: F64, people: F64 = NOBODY, far_m: float = 20.0) -> bool:
    sight = make_sight(len(scene.block_low))
    look(scene, sight, *map(float, a), far_m)
    return bool(hides(scene, people, sight, *map(float, b)))


@pytest.mark.parametrize(
    ("from_m", "to_m", "hidden"),
    [
        ([1, 2, 0.5], [3.5, 2, 0.5], True),
        ([1, 2, 0.8], [3.5, 2, 0.8], False),
        ([1, 2, 0.1], [3.5, 2, 1.5], True),
        ([1, 2, 2.0], [6.0, 2, 2.0], True),
        ([1, 2, 1.5], [6.0, 2, 1.5], False),
        ([1, 2, 2.3], [6.0, 2, 2.3], False),
        ([1, 4, 0.5], [6.0, 4, 0.5], False),
    ],
)
def test_sight_passes_over_a_table_and_below_a_lamp(
    from_m: list[float], to_m: list[float], hidden: bool
) -> None:
    scene, a, b = scene_with(TABLE, LAMP), np.array(from_m), np.array(to_m)
    assert is_hidden(scene, a, b) == is_hidden(scene, b, a) == hidden


@pytest.mark.parametrize(("height_m", "hidden"), [(1.6, True), (1.8, False)])
def test_sight_passes_over_a_person(height_m: float, hidden: bool) -> None:
    people, a, b = np.array([[4.0, 4.0]]), np.array([1, 4, height_m]), np.array([7, 4, height_m])
    assert is_hidden(scene_with(), a, b, people) == hidden


@pytest.mark.parametrize(("to_m", "hidden"), [([2.5, 4.8, 1.0], True), ([1, 4, 1.0], False)])
def test_nobody_sees_round_a_corner(to_m: list[float], hidden: bool) -> None:
    outline = np.array([[0, 0], [6, 0], [6, 3], [3, 3], [3, 5], [0, 5]], dtype=float)
    scene = scene_of(Room(outline, 2.5, (PLAIN,) * 6, PLAIN, PLAIN))
    assert is_hidden(scene, np.array([5.0, 1.0, 1.0]), np.array(to_m)) == hidden


def by_crossings(scene: Scene, a: F64, b: F64) -> bool:
    """The same by all that the line crosses in plan, and at what height."""
    crossings = make_crossings(len(scene.block_low))
    count = note_crossings(scene, NOBODY, crossings, 0, 0.0, a[0], a[1], b[0], b[1])
    slope = (b[2] - a[2]) / np.linalg.norm((b - a)[:2])
    ends = a[2] + slope * np.stack([crossings.enter[:count], crossings.leave[:count]])
    low, high = crossings.low[:count], crossings.high[:count]
    return bool(((ends.min(axis=0) < high) & (ends.max(axis=0) > low)).any())


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), count=st.sampled_from([1, 5, FEW_BLOCKS + 9]))
def test_sight_agrees_with_what_the_line_crosses(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    blocks = [
        Block(
            f"{k}", PLAIN, generator.uniform([0, 0], [8, 6]), generator.uniform(0.1, 2.0, 3),
            generator.uniform(0, 3), generator.uniform(0, 0.5), 0.0,
        )
        for k in range(count)
    ]  # fmt: skip
    scene = scene_with(*blocks)
    for a, b in generator.uniform([0, 0, 0], [8, 6, 2.5], (10, 2, 3)):
        assert is_hidden(scene, a, b) == by_crossings(scene, a, b)

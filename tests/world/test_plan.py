"""What lies across a line in plan, against plain geometry block by block."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from planted_blocks import LAMP, NOBODY, PLAIN, TABLE, random_blocks, scene_with, scene_with_a_notch

from elfslam.base.arrays import F64
from elfslam.world import plan
from elfslam.world.room import Block
from elfslam.world.scene import FEW_BLOCKS, Scene


def crossed(scene: Scene, a: F64, b: F64, people: F64 = NOBODY, start: float = 0.0) -> F64:
    """Enter, leave, low and high of each obstacle (k, 4), sorted."""
    crossings = plan.make_crossings(len(scene.block_low))
    count = plan.note_crossings(scene, people, crossings, 0, start, a[0], a[1], b[0], b[1])
    found = np.column_stack(crossings[:4])[:count]
    return found[np.lexsort(found.T[::-1])]


def test_a_line_enters_and_leaves_what_it_crosses() -> None:
    scene = scene_with(TABLE, LAMP)
    found = crossed(scene, np.array([1.0, 2.0]), np.array([7.0, 2.0]), start=10.0)
    np.testing.assert_allclose(found, [[11, 12, 0, 0.7], [13, 14, 1.8, 2.2]])


@pytest.mark.parametrize(
    ("a", "b"), [([1, 0.9999], [7, 0.9999]), ([1, 3.5], [7, 3.5]), ([1, 2], [3, 0])]
)
def test_passing_by_or_touching_a_corner_is_not_crossing(a: list[float], b: list[float]) -> None:
    assert not len(crossed(scene_with(TABLE), np.array(a, float), np.array(b, float)))


def test_a_person_is_a_cylinder() -> None:
    people = np.array([[4.0, 3.0], [4.0, 5.0]])
    (found,) = crossed(scene_with(), np.array([1.0, 3.0]), np.array([7.0, 3.0]), people)
    expected = [3 - plan.PERSON_RADIUS_M, 3 + plan.PERSON_RADIUS_M, 0.0, plan.PERSON_HEIGHT_M]
    np.testing.assert_allclose(found, expected)


def plain_crossings(blocks: list[Block], a: F64, b: F64) -> F64:
    """The same by clipping the line to each block's slabs in its own frame."""
    rows = []
    for block in blocks:
        cos, sin = np.cos(block.turn_rad), np.sin(block.turn_rad)
        to_local = np.array([[cos, -sin], [sin, cos]])
        p, d = (a - block.centre_m) @ to_local, (b - a) @ to_local
        half = block.size_m[:2] / 2
        with np.errstate(divide="ignore"):
            t = np.sort([(-half - p) / d, (half - p) / d], axis=0)
        enter, leave = max(t[0].max(), 0.0), min(t[1].min(), 1.0)
        length = np.linalg.norm(b - a)
        if (leave - enter) * length > 1e-6:
            rows.append([enter * length, leave * length, block.base_m, block.top_m])
    found = np.array(rows).reshape(-1, 4)
    return found[np.lexsort(found.T[::-1])]


@settings(max_examples=60)
@given(seed=st.integers(0, 10_000), count=st.sampled_from([1, 5, FEW_BLOCKS + 9]))
def test_the_grid_finds_what_looking_at_every_block_finds(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    blocks = random_blocks(generator, count)
    scene = scene_with(*blocks)
    for a, b in generator.uniform([0, 0], [8, 6], (10, 2, 2)):
        np.testing.assert_allclose(crossed(scene, a, b), plain_crossings(blocks, a, b), atol=1e-9)


@pytest.mark.parametrize(
    ("a", "b", "met"),
    [([5.5, 2.5], [1, 4], True), ([5, 1], [1, 1], False), ([5, 2], [2, 4.9], True)],
)
def test_a_line_across_the_notch_meets_its_walls(a: list[float], b: list[float], met: bool) -> None:
    scene = scene_with_a_notch()
    assert bool(plan.meets_wall(scene, *map(float, a), *map(float, b), -1, -1)) == met


def test_a_wall_is_not_met_by_lines_that_start_on_it() -> None:
    """From just behind the side x = 3 of the notch, as rounding may have it."""
    scene = scene_with_a_notch()
    line = (3.0 + 1e-12, 4.0, 1.0, 2.0)
    assert plan.meets_wall(scene, *line, -1, -1)
    assert not plan.meets_wall(scene, *line, 3, -1)
    assert not plan.meets_wall(scene, line[2], line[3], line[0], line[1], -1, 3)


def sight_from(scene: Scene, place_m: F64, far_m: float = 20.0) -> plan.Sight:
    sight = plan.make_sight(len(scene.block_low))
    plan.look(scene, sight, *map(float, place_m), far_m)
    return sight


def is_hidden(scene: Scene, a: F64, b: F64, people: F64 = NOBODY) -> bool:
    return bool(plan.hides(scene, people, sight_from(scene, a), *map(float, b)))


@pytest.mark.parametrize(("height_m", "hidden"), [(1.6, True), (1.8, False)])
def test_sight_passes_over_a_person(height_m: float, hidden: bool) -> None:
    people, a, b = np.array([[4.0, 4.0]]), np.array([1, 4, height_m]), np.array([7, 4, height_m])
    assert is_hidden(scene_with(), a, b, people) == hidden


CLEAR_M = 1e-3
"""Lines that pass a box this closely may go either way."""


def random_block(generator: np.random.Generator, k: int) -> Block:
    size = generator.uniform([0.05, 0.05, 0.1], [3.0, 3.0, 2.4])
    centre, base_m = generator.uniform(0.0, [8.0, 6.0]), float(generator.choice([0.0, 1.0]))
    return Block(f"{k}", PLAIN, centre, size, generator.uniform(-np.pi, np.pi), base_m, 0.0)


def length_inside_m(block: Block, a: F64, b: F64, grown_m: float) -> float:
    """How much of a segment lies in a box grown to all sides, cut slab by slab in space."""
    cos, sin = np.cos(block.turn_rad), np.sin(block.turn_rad)
    middle = np.append(block.centre_m, block.base_m + block.size_m[2] / 2)
    own = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    start, along, half = (a - middle) @ own, (b - a) @ own, block.size_m / 2 + grown_m
    cuts = np.sort([(-half - start) / along, (half - start) / along], axis=0)
    enter, leave = max(cuts[0].max(), 0.0), min(cuts[1].min(), 1.0)
    return max(leave - enter, 0.0) * float(np.linalg.norm(along))


@settings(max_examples=100)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 30))
def test_a_point_is_hidden_where_a_box_is_cut_in_space(seed: int, count: int) -> None:
    generator = np.random.default_rng(seed)
    blocks = [random_block(generator, k) for k in range(count)]
    scene, place = scene_with(*blocks), generator.uniform(0.0, [8.0, 6.0, 2.5])
    sight = sight_from(scene, place)
    for point in generator.uniform(0.0, [8.0, 6.0, 2.5], (20, 3)):
        through = any(length_inside_m(block, place, point, -CLEAR_M) > CLEAR_M for block in blocks)
        touched = any(length_inside_m(block, place, point, CLEAR_M) > 0 for block in blocks)
        hidden = bool(plan.hides(scene, NOBODY, sight, *point))
        assert hidden or not through
        assert touched or not hidden


def test_what_is_farther_than_asked_for_is_left_out_and_nothing_else() -> None:
    generator = np.random.default_rng(2)
    scene = scene_with(*[random_block(generator, k) for k in range(30)])
    place = np.array([2.0, 2.0, 1.2])
    near, far = sight_from(scene, place, 2.0), sight_from(scene, place)
    assert near.filled.sum() < far.filled.sum()
    for point in place + generator.uniform(-1.4, 1.4, (300, 3)) * [1.0, 1.0, 0.8]:
        verdicts = [bool(plan.hides(scene, NOBODY, sight, *point)) for sight in (near, far)]
        assert verdicts[0] == verdicts[1]

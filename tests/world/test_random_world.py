"""Random rooms are rooms: simple outlines, the sizes asked for, furniture inside, one per seed."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.world.materials import Material
from elfslam.world.random_world import (
    CORNER_SHARE,
    GONE_SHARE,
    HIGH_FROM_M2,
    LEANING_SHARE,
    MOST_FURNITURE,
    MOST_PARTITIONS,
    MOVED_SHARE,
    NEW_SURFACE_SHARE,
    changed_room,
    random_room,
)
from elfslam.world.room import Block, Room, check_outline
from elfslam.world.scene import scene_of

ROOMS = 300


def room_of(seed: int) -> Room:
    return random_room(np.random.default_rng(seed))


@pytest.fixture(scope="module")
def rooms() -> list[Room]:
    return [room_of(seed) for seed in range(ROOMS)]


def area_m2(outline_m: np.ndarray) -> float:
    x, y = outline_m.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


def is_square(room: Room) -> bool:
    along = np.diff(room.outline_m, axis=0, append=room.outline_m[:1])
    return bool((np.abs(along).min(axis=1) < 1e-9).all())


def surfaces_of(room: Room) -> list[Material]:
    return [*room.walls, room.floor, room.ceiling, *(block.surface for block in room.blocks)]


def test_outlines_are_simple_and_counter_clockwise(rooms: list[Room]) -> None:
    for room in rooms:
        assert (check_outline(room.outline_m) == room.outline_m).all()
        assert len(room.walls) == len(room.outline_m) in (4, 6)


def test_rooms_have_the_sizes_of_rooms(rooms: list[Room]) -> None:
    """Boxes up to 1600 m2; a corner cut out takes a third of it at most."""
    for room in rooms:
        length, width, height = room.size_m
        assert (room.corner_m >= 0).all()
        assert 0.65 * 4.0 <= area_m2(room.outline_m) <= length * width + 1e-9 <= 1600.0 + 1e-6
        assert 0.9 <= length / width <= 12.5
        assert 2.3 <= height <= (3.6 if length * width < 0.7 * HIGH_FROM_M2 else 6.0)
    areas = np.array([area_m2(room.outline_m) for room in rooms])
    assert np.median(areas) == pytest.approx(100.0, rel=0.4), "even on a logarithmic scale"


def test_some_lack_a_corner_and_some_lean(rooms: list[Room]) -> None:
    lacking = np.mean([len(room.outline_m) == 6 for room in rooms])
    leaning = np.mean([not is_square(room) for room in rooms])
    assert lacking == pytest.approx(CORNER_SHARE, abs=0.08)
    assert leaning == pytest.approx(LEANING_SHARE, abs=0.08)
    assert all(scene_of(room).convex == (len(room.outline_m) == 4) for room in rooms[:30])


def test_blocks_stand_in_the_room(rooms: list[Room]) -> None:
    for room in rooms:
        for block in room.blocks:
            assert room.holds(block.corners_m).all()
            assert 0 <= block.base_m < block.top_m <= room.height_m + 1e-9


def is_partition(block: Block) -> bool:
    return block.clutter_per_m2 == 0


def test_furniture_and_partitions_are_as_many_as_fit(rooms: list[Room]) -> None:
    partitions = [sum(map(is_partition, room.blocks)) for room in rooms]
    furniture = [len(room.blocks) - count for room, count in zip(rooms, partitions, strict=True)]
    assert 0.8 * MOST_FURNITURE < max(furniture) <= MOST_FURNITURE
    assert np.median(furniture) > 5
    assert (min(partitions), max(partitions)) == (0, MOST_PARTITIONS)
    size = [area_m2(room.outline_m) for room in rooms]
    assert np.corrcoef(np.minimum(size, 200.0), furniture)[0, 1] > 0.5
    names = [[block.name for block in room.blocks] for room in rooms]
    assert all(len(set(each)) == len(each) for each in names), "clutter is drawn by name"


def test_surfaces_reflect_and_differ(rooms: list[Room]) -> None:
    for room in rooms:
        reflections = np.array([surface.reflection for surface in surfaces_of(room)])
        assert 0.18 <= reflections.min() <= reflections.max() <= 0.98 + 1e-9
        assert len(np.unique(reflections)) > 2
    level = [np.mean([wall.reflection for wall in room.walls]) for room in rooms]
    assert np.std(level) > 0.08, "rooms are more or less lively"


@pytest.fixture(scope="module")
def changed(rooms: list[Room]) -> list[Room]:
    return [changed_room(np.random.default_rng(k), room) for k, room in enumerate(rooms)]


def test_a_changed_room_keeps_its_shape_and_partitions(
    rooms: list[Room], changed: list[Room]
) -> None:
    for before, after in zip(rooms, changed, strict=True):
        assert (after.outline_m == before.outline_m).all()
        assert (after.height_m, after.seed) == (before.height_m, before.seed)
        assert len(after.walls) == len(before.walls)
        kept = [block for block in before.blocks if is_partition(block)]
        assert [block for block in after.blocks if is_partition(block)] == kept


def test_some_of_the_walls_are_new(rooms: list[Room], changed: list[Room]) -> None:
    new = [
        now is not then
        for before, after in zip(rooms, changed, strict=True)
        for then, now in zip(
            (*before.walls, before.floor, before.ceiling),
            (*after.walls, after.floor, after.ceiling),
            strict=True,
        )
    ]
    assert np.mean(new) == pytest.approx(NEW_SURFACE_SHARE, abs=0.04)


def test_some_of_the_furniture_is_gone_or_moved(rooms: list[Room], changed: list[Room]) -> None:
    gone, moved = [], []
    for before, after in zip(rooms, changed, strict=True):
        now = {block.name: block for block in after.blocks}
        for block in before.blocks:
            if is_partition(block):
                continue
            gone.append(block.name not in now)
            moved.append(not gone[-1] and now[block.name] is not block)
            if moved[-1]:
                assert after.holds(now[block.name].corners_m).all()
                assert now[block.name].turn_rad != block.turn_rad
    assert np.mean(gone) == pytest.approx(GONE_SHARE, abs=0.04)
    assert 0.5 * MOVED_SHARE < np.mean(moved) < MOVED_SHARE, "some would leave the room and stay"

"""Walks over the same two floors, planted: one counts from below, the other from above."""

from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base import values
from elfslam.base.building import Building, BuildingFloor
from elfslam.base.errors import InputError
from elfslam.base.geometry import compose
from elfslam.slam.merging import MappedWalk, MergeParameters, merge
from elfslam.slam.merging.floors import (
    add_to_building,
    merged_building,
    merged_floors,
    numbered_alike,
)
from elfslam.slam.merging.members import links_between, side_of

KNOWN = MergeParameters()
LAP = 60
ECHOES = 4
"""Of a footstep."""
SOUND = np.random.default_rng(100).normal(size=(2, LAP, 32))
"""By floor and place on it."""
HEIGHT_M = (0.0, 4.0)


def walk(name: str, *plan: int) -> MappedWalk:
    """A lap round a hall on each floor of the plan, whose levels it counts from the first."""
    angle = 2 * np.pi * np.arange(LAP * len(plan) + 1) / LAP
    poses = np.column_stack([7 * np.cos(angle), 7 * np.sin(angle), angle + np.pi / 2])
    t_s = np.arange(len(angle)) * 0.5
    vectors = np.repeat(np.concatenate([SOUND[floor] for floor in plan]), ECHOES, axis=0)
    vectors = vectors + 0.2 * np.random.default_rng(len(name)).normal(size=vectors.shape)
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    heard_s = (np.arange(len(vectors)) + 0.5) * 0.5 / ECHOES
    when = [(k * LAP * 0.5, float(floor - plan[0]), None) for k, floor in enumerate(plan)]
    rows = [when[0]]
    for at_s, level, _ in when[1:]:
        rows += [(at_s - 1.0, np.nan, values.LevelPassage.STAIRS), (at_s + 1.0, level, None)]
    at_s, level, by = zip(*rows, strict=True)
    covariance = np.tile(np.eye(3) * 1e-4, (len(t_s), 1, 1))
    return MappedWalk(
        name,
        values.Odometry(t_s, poses, np.tile([0.02, 0.02, 0.005], (len(t_s) - 1, 1))),
        values.Trajectory(t_s, poses, covariance, np.zeros(0), "OK"),
        values.NO_CLOSURES,
        values.Features(heard_s, vectors, "planted"),
        levels=values.Levels(np.array(at_s), np.array(level), by),
    )


def floors(plan: tuple[int, ...]) -> tuple[BuildingFloor, ...]:
    own = sorted({(floor - plan[0], HEIGHT_M[floor] - HEIGHT_M[plan[0]]) for floor in plan})
    return tuple(BuildingFloor(*each) for each in own)


UP, DOWN = (0, 1), (1, 0)


def test_whose_levels_count_from_elsewhere_is_numbered_by_the_sound() -> None:
    both = [walk("one", *UP), walk("other", *DOWN)]
    walks, numbered = numbered_alike(both, [floors(UP), floors(DOWN)], KNOWN)
    assert floors(DOWN)[0].level == -1
    assert [each.level for each in numbered[1]] == [0, 1]
    npt.assert_array_equal(walks[1].levels.level, [1, np.nan, 0])


def test_heights_that_fit_nowhere_are_refused() -> None:
    high = (BuildingFloor(0, 0.0), BuildingFloor(1, 9.0))
    with pytest.raises(InputError, match="wanted two or more of equal heights"):
        numbered_alike([walk("one", *UP), walk("other", *UP)], [floors(UP), high], KNOWN)


def test_nothing_links_two_floors() -> None:
    one, other = walk("one", *UP), walk("other", *UP)
    sides = side_of(one, KNOWN), side_of(other, KNOWN)
    links = links_between(*sides, KNOWN)
    assert len(links.i) > 20
    assert (sides[0].level[links.i] == sides[1].level[links.j]).all()
    elsewhere = replace(other.levels, level=other.levels.level + 1)
    moved = links_between(sides[0], side_of(replace(other, levels=elsewhere), KNOWN), KNOWN)
    assert len(moved.i) < len(links.i) / 2


def test_walks_are_one_building_with_a_map_a_floor() -> None:
    given = [walk("one", *UP), walk("other", *DOWN)]
    walks, numbered = numbered_alike(given, [floors(UP), floors(DOWN)], KNOWN)
    made = merge(walks, KNOWN)
    assert made.refused == {}
    trajectories = made.maps[0].trajectories
    merged = merged_floors(walks, trajectories, numbered, KNOWN)
    assert list(merged) == [0, 1]
    for level, floor in merged.items():
        assert floor.floor_map.sources == ("one", "other")
        assert set(floor.trajectories) == {"one", "other"}
        off_m = np.linalg.norm(floor.floor_map.xy_m, axis=1) - 7
        npt.assert_allclose(off_m, 0, atol=0.3)
        there = floor.floor_map.walk == 0
        assert there.sum() == pytest.approx(LAP * ECHOES, rel=0.1), level
    building = merged_building("hall", walks, trajectories, numbered, [0, 1])
    assert [each.height_m for each in building.floors] == [0, 4]
    assert {each.kind for each in building.passages} == {values.LevelPassage.STAIRS}


def merged() -> tuple[Building, dict[int, values.FloorMap]]:
    """A building of two walks and the maps of its floors."""
    walks, numbered = [walk("one", *UP), walk("two", *UP)], [floors(UP)] * 2
    trajectories = merge(walks, KNOWN).maps[0].trajectories
    made = merged_floors(walks, trajectories, numbered, KNOWN)
    building = merged_building("hall", walks, trajectories, numbered, list(made))
    return building, {level: each.floor_map for level, each in made.items()}


def test_a_further_walk_joins_all_floors_by_one_alignment() -> None:
    building, maps = merged()
    moved = walk("third", *DOWN)
    away = compose(np.array([30.0, -4.0, 2.0]), moved.trajectory.world_from_body)
    moved = replace(moved, trajectory=replace(moved.trajectory, world_from_body=away))
    grown, joined, found, there = add_to_building(building, maps, moved, floors(DOWN), KNOWN)
    assert found.refusal == ""
    assert [each.level for each in there] == [0, 1]
    assert grown.floors == building.floors
    for level, each in joined.items():
        assert each.floor_map.sources == ("one", "two", "third"), level
        off_m = np.linalg.norm(each.trajectories["third"].world_from_body[:, :2], axis=1) - 7
        npt.assert_allclose(off_m, 0, atol=0.4)
    assert sorted(joined) == [0, 1]


@pytest.mark.parametrize("floor", [0, 1])
def test_a_walk_of_one_floor_finds_which(floor: int) -> None:
    building, maps = merged()
    single = replace(walk("third", floor), levels=None)
    grown, joined, found, there = add_to_building(building, maps, single, (), KNOWN)
    assert found.refusal == ""
    assert list(joined) == [floor] == [each.level for each in there]
    assert grown.passages == building.passages


def test_a_floor_where_nobody_had_been_joins_the_building() -> None:
    building, maps = merged()
    lower = Building("hall", building.floors[:1])
    grown, joined, _, _ = add_to_building(
        building, {0: maps[0]}, walk("third", *UP), floors(UP), KNOWN
    )
    assert grown.levels == (0, 1)
    assert joined[1].floor_map.sources == ("third",)
    with pytest.raises(InputError, match="two or more of equal heights"):
        add_to_building(lower, {0: maps[0]}, walk("third", *UP), floors(UP), KNOWN)


def test_who_was_elsewhere_stays_out_unless_the_start_is_known() -> None:
    building, maps = merged()
    strange = np.random.default_rng(7).normal(size=(2 * LAP * ECHOES, 32))
    strange /= np.linalg.norm(strange, axis=1, keepdims=True)
    other = walk("other", *UP)
    other = replace(other, features=replace(other.features, vectors=strange.astype(np.float32)))
    same, joined, found, _ = add_to_building(building, maps, other, floors(UP), KNOWN)
    assert same is building
    assert not joined
    assert found.refusal
    _, joined, found, _ = add_to_building(
        building, maps, other, floors(UP), KNOWN, known_start=True
    )
    assert found.refusal == "", "nothing needs evidence"
    assert joined[0].floor_map.sources == ("one", "two", "other")

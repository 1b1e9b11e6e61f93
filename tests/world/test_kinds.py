"""Kinds of walks: a quiet day is the simulator's own, ordinary life differs between two visits."""

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import ParameterError
from elfslam.world import kinds
from elfslam.world.circumstances import Circumstances, device_of
from elfslam.world.materials import material
from elfslam.world.room import Room, box, shoebox
from elfslam.world.simulate import WALKERS
from elfslam.world.walker import smooth_lap
from elfslam.world.world_file import load_world


def room_of(area_m2: float) -> Room:
    side_m = area_m2**0.5
    return shoebox(np.array([side_m, side_m, 3.0]), (material("plaster"),) * 6)


def test_a_quiet_day_is_what_simulate_gives_by_itself() -> None:
    room = room_of(400.0)
    assert kinds.QUIET.mapping(room) == kinds.QUIET.asking(room) == Circumstances()
    assert kinds.QUIET.walker == WALKERS[0]


@pytest.mark.parametrize("kind", [kinds.SURVEYOR, kinds.PEOPLE], ids=lambda kind: kind.name)
def test_who_asks_comes_on_another_day_with_another_phone(kind: kinds.Kind) -> None:
    mapping, asking = kind.mapping(room_of(400.0)), kind.asking(room_of(400.0))
    assert mapping.engine == asking.engine == "diffuse"
    assert mapping.day == 0 < asking.day
    phones = [device_of(today) for today in (mapping, asking)]
    assert phones[0].name != phones[1].name
    assert all(phone.ringing for phone in phones)
    assert mapping.lived_in
    assert asking.lived_in


def test_the_larger_the_place_the_more_people_are_about() -> None:
    about = [kinds.people_about(room_of(area_m2)) for area_m2 in (60.0, 360.0, 2000.0)]
    assert about[0] == 0 < about[1] < about[2]


def test_kinds_are_known_by_name_and_others_refused() -> None:
    assert [kinds.kind_named(name) for name in kinds.KINDS] == list(kinds.KINDS.values())
    assert {kind.walker for kind in kinds.KINDS.values()} == set(WALKERS)
    with pytest.raises(ParameterError, match="kind 'lazy': wanted people, surveyor, quiet"):
        kinds.kind_named("lazy")


def test_people_ask_on_other_ways_and_surveyors_on_the_mapped_one() -> None:
    world = load_world("studio")
    assert kinds.SURVEYOR.asking_place(world, 1) is kinds.QUIET.asking_place(world, 1) is world
    one, again, other = (kinds.PEOPLE.asking_place(world, seed).route_m for seed in (1, 1, 2))
    assert (one == again).all()
    assert one.shape != world.route_m.shape
    assert one.shape != other.shape or (one != other).any()


PLASTER = (material("plaster"),) * 6
ROUTE_M = np.array([[1.0, 1.0], [9.0, 1.0], [9.0, 7.0], [1.0, 7.0]])


def away_m(points_m: F64, route_m: F64) -> F64:
    lap_xy, _ = smooth_lap(route_m)
    return np.linalg.norm(points_m[:, None] - lap_xy[None, ::5], axis=2).min(axis=1)


@pytest.mark.parametrize("seed", range(3))
def test_a_part_is_kept_and_a_part_cut_across(seed: int) -> None:
    room = shoebox(np.array([10.0, 8.0, 3.0]), PLASTER)
    route_m = kinds.crossing_route(room, ROUTE_M, np.random.default_rng(seed))
    lap_xy, length_m = smooth_lap(route_m)
    off_m = away_m(lap_xy, ROUTE_M)
    assert off_m.max() > kinds.LEFT_OUT_M
    assert 0.3 < (off_m < 0.3).mean() < 0.95
    assert length_m < smooth_lap(ROUTE_M)[1]


def test_where_nothing_leads_across_the_route_stays() -> None:
    filled = box("block", np.array([1.4, 1.4, 0.0]), np.array([7.2, 5.2, 2.0]))
    room = shoebox(np.array([10.0, 8.0, 3.0]), PLASTER, (filled,))
    assert kinds.crossing_route(room, ROUTE_M, np.random.default_rng(0)) is ROUTE_M

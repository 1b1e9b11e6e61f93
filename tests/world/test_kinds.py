"""Kinds of walks: a quiet day is the simulator's own, ordinary life differs between two visits."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.errors import ParameterError
from elfslam.world.circumstances import Circumstances, device_of
from elfslam.world.kinds import KINDS, PEOPLE, QUIET, SURVEYOR, Kind, kind_named, people_about
from elfslam.world.materials import material
from elfslam.world.room import Room, shoebox
from elfslam.world.simulate import WALKERS
from elfslam.world.world_file import load_world


def room_of(area_m2: float) -> Room:
    side_m = area_m2**0.5
    return shoebox(np.array([side_m, side_m, 3.0]), (material("plaster"),) * 6)


def test_a_quiet_day_is_what_simulate_gives_by_itself() -> None:
    room = room_of(400.0)
    assert QUIET.mapping(room) == QUIET.asking(room) == Circumstances()
    assert QUIET.walker == WALKERS[0]


@pytest.mark.parametrize("kind", [SURVEYOR, PEOPLE], ids=lambda kind: kind.name)
def test_who_asks_comes_on_another_day_with_another_phone(kind: Kind) -> None:
    mapping, asking = kind.mapping(room_of(400.0)), kind.asking(room_of(400.0))
    assert mapping.engine == asking.engine == "diffuse"
    assert mapping.day == 0 < asking.day
    phones = [device_of(today) for today in (mapping, asking)]
    assert phones[0].name != phones[1].name
    assert all(phone.ringing for phone in phones)
    assert mapping.lived_in
    assert asking.lived_in


def test_the_larger_the_place_the_more_people_are_about() -> None:
    about = [people_about(room_of(area_m2)) for area_m2 in (60.0, 360.0, 2000.0)]
    assert about[0] == 0 < about[1] < about[2]


def test_kinds_are_known_by_name_and_others_refused() -> None:
    assert [kind_named(name) for name in KINDS] == list(KINDS.values())
    assert {kind.walker for kind in KINDS.values()} == set(WALKERS)
    with pytest.raises(ParameterError, match="kind 'lazy': wanted people, surveyor, quiet"):
        kind_named("lazy")


def test_people_ask_on_other_ways_and_surveyors_on_the_mapped_one() -> None:
    world = load_world("studio")
    assert SURVEYOR.asking_place(world, 1) is QUIET.asking_place(world, 1) is world
    one, again, other = (PEOPLE.asking_place(world, seed).route_m for seed in (1, 1, 2))
    assert (one == again).all()
    assert one.shape != world.route_m.shape
    assert one.shape != other.shape or (one != other).any()

"""Doors: what they put into a room, and what a day makes of them."""

from dataclasses import replace

import numpy as np
import pytest
from one_phone import AIR, DEAD, FIRST_ORDER, UP, ends_at
from planted_blocks import loaded

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError
from elfslam.world import doors
from elfslam.world.circumstances import Circumstances, room_on
from elfslam.world.kinds import PEOPLE
from elfslam.world.materials import Material, material
from elfslam.world.phone import image_echoes
from elfslam.world.pulses import BASEBAND_HZ
from elfslam.world.room import Block, Room, fault_of_route, shoebox
from elfslam.world.scattering import as_measured
from elfslam.world.scene import scene_of
from elfslam.world.world_file import World, parse_world, world_names

HARD = Material("hard", 0.1, 0.0, "planted")
SIZE_M = np.array([8.0, 4.0, 3.0])
NOBODY = np.zeros((0, 2))
PHONE_M, BEHIND_M = np.array([1.5, 2.0, 1.2]), np.array([6.0, 2.0, 1.2])
EAST_M = 2 * (8.0 - 1.5)
"""Way to the hard east wall and back, through the opening."""


def screen(name: str, low_m: float, high_m: float) -> Block:
    """A part of the wall at x = 3, up to the ceiling."""
    size_m = np.array([0.1, high_m - low_m, 3.0])
    return Block(name, DEAD, np.array([3.0, (low_m + high_m) / 2]), size_m, clutter_per_m2=0.0)


def divided() -> Room:
    """Two rooms with an opening of 1 m between them; all is dead but the east wall."""
    walls = (DEAD, HARD, DEAD, DEAD, DEAD, DEAD)
    return shoebox(SIZE_M, walls, (screen("south", 0.0, 1.5), screen("north", 2.5, 4.0)), 5)


def door_of(**changes: object) -> doors.HingedDoor:
    door = doors.HingedDoor("door", HARD, np.array([3.0, 1.5]), np.array([3.0, 2.5]), height_m=3.0)
    return replace(door, **changes)


def outer_door() -> doors.HingedDoor:
    """In the east wall, before the phone; it opens into the room."""
    return doors.HingedDoor("exit", HARD, np.array([8.0, 1.5]), np.array([8.0, 2.5]), 3.0)


def after_m(room: Room, metres: float) -> float:
    """How loud the echo is that has gone so far."""
    ends = ends_at(PHONE_M, PHONE_M + 1e-3 * UP)
    out = image_echoes(scene_of(room), ends, NOBODY[None], AIR, FIRST_ORDER)[0]
    at = round(metres / AIR.speed_mps * BASEBAND_HZ)
    return float(np.abs(out[at - 1 : at + 2]).max())


def opened(door: doors.HingedDoor, room: Room, *, is_open: bool) -> Room:
    return replace(room, blocks=(*room.blocks, *doors.blocks_of(door, room, is_open=is_open)))


def test_a_shut_leaf_reaches_from_end_to_end_and_an_open_one_stands_to_the_left() -> None:
    assert doors.leaf_ends(door_of(), is_open=False).tolist() == [[[3.0, 1.5], [3.0, 2.5]]]
    [[hinge, tip]] = doors.leaf_ends(door_of(), is_open=True)
    assert (hinge.tolist(), tip.tolist()) == ([3.0, 1.5], pytest.approx([2.0, 1.5]))
    [[_, right]] = doors.leaf_ends(door_of(open_rad=-np.pi / 2), is_open=True)
    assert right == pytest.approx(np.array([4.0, 1.5]))


def test_two_leaves_meet_in_the_middle_and_open_to_one_side() -> None:
    double = door_of(leaves=2, open_rad=np.pi / 3)
    shut, wide = (doors.leaf_ends(double, is_open=is_open) for is_open in (False, True))
    assert shut[:, 0].tolist() == wide[:, 0].tolist() == [[3.0, 1.5], [3.0, 2.5]]
    assert shut[:, 1] == pytest.approx(np.array([[3.0, 2.0], [3.0, 2.0]]))
    away = 0.5 * np.sin(np.pi / 3)
    assert wide[:, 1] == pytest.approx(np.array([[3.0 - away, 1.75], [3.0 - away, 2.25]]))


@pytest.mark.parametrize("turn_rad", [0.0, 0.7, -2.4])
def test_leaves_are_blocks_where_their_ends_are(turn_rad: float) -> None:
    door = door_of(open_rad=turn_rad, height_m=2.0)
    [leaf] = doors.blocks_of(door, divided(), is_open=True)
    [[hinge, tip]] = doors.leaf_ends(door, is_open=True)
    assert leaf.centre_m == pytest.approx((hinge + tip) / 2)
    assert leaf.turn(np.array([[0.5, 0.0]]))[0] == pytest.approx((tip - hinge) / 2)
    assert (leaf.size_m[0], leaf.top_m, leaf.surface) == (pytest.approx(1.0), 2.0, HARD)


def test_a_mirror_beyond_an_opening_is_heard_while_its_door_is_open() -> None:
    gap, wide, shut = (
        after_m(room, EAST_M)
        for room in (
            divided(),
            opened(door_of(), divided(), is_open=True),
            opened(door_of(), divided(), is_open=False),
        )
    )
    assert gap > 0.01
    assert wide == pytest.approx(gap)
    assert shut < 1e-3 * gap


def test_a_door_in_an_outer_wall_is_the_wall_while_it_is_shut() -> None:
    room = divided()
    assert doors.in_outer_wall(outer_door(), room)
    assert not doors.in_outer_wall(door_of(), room)
    assert doors.blocks_of(outer_door(), room, is_open=False) == ()


def test_nothing_comes_back_from_an_open_doorway() -> None:
    room = divided()
    leaf, way = doors.blocks_of(outer_door(), room, is_open=True)
    assert way.surface is doors.DOORWAY
    assert way.corners_m.min(axis=0) == pytest.approx([7.98, 1.5])
    assert way.corners_m.max(axis=0) == pytest.approx([8.0, 2.5])
    assert room.holds(leaf.centre_m[None]).all()
    before, after = after_m(room, EAST_M), after_m(opened(outer_door(), room, is_open=True), EAST_M)
    assert after < 1e-3 * before


def test_a_doorway_absorbs_all_in_measured_rooms_too() -> None:
    room = as_measured(opened(outer_door(), divided(), is_open=True))
    assert room.blocks[-1].surface is doors.DOORWAY
    assert material("acoustic partition").absorption < 1, "no material is taken for an opening"


def is_open(room: Room, door: doors.HingedDoor) -> bool:
    [leaf] = [block for block in room.blocks if block.name == f"{door.name} leaf 1"]
    return bool(np.abs(leaf.turn_rad - np.pi / 2) > 0.1)


def test_a_day_finds_a_door_open_or_shut_the_same_every_time() -> None:

    door = door_of()

    def found(room: Room, days: int) -> list[bool]:
        return [is_open(doors.with_doors(room, [door], [], day), door) for day in range(days)]

    days = found(divided(), 400)
    assert found(divided(), 40) == days[:40] != found(replace(divided(), seed=6), 40)
    assert np.mean(days) == pytest.approx(doors.OPEN_SHARE, abs=0.1)


def test_a_door_that_somebody_walks_through_is_open() -> None:
    through, past = np.array([[1.0, 2.0], [6.0, 2.0]]), np.array([[2.7, 0.5], [2.7, 3.5]])
    assert doors.leads_through(through, door_of())
    assert not doors.leads_through(past, door_of())
    rooms = (doors.with_doors(divided(), [door_of()], [past, through], k) for k in range(20))
    assert all(is_open(room, door_of()) for room in rooms)


def test_walkers_mind_leaves_wherever_they_may_stand() -> None:
    """Beside the way as well, whatever the day; one that they walk through is never shut."""
    ways: list[F64] = [np.array([[1.0, 2.0], [6.0, 2.0]])]
    names = [block.name for block in doors.room_to_walk_in(divided(), [door_of()], []).blocks]
    assert names.count("door leaf 1") == 2
    led = doors.room_to_walk_in(divided(), [door_of()], ways)
    assert fault_of_route(led, ways[0], closed=False) is None
    barred = doors.room_to_walk_in(divided(), [door_of()], [])
    assert 'meets "door leaf 1"' in str(fault_of_route(barred, ways[0], closed=False))
    room = divided()
    assert doors.room_to_walk_in(room, [], ways) is room


@pytest.mark.parametrize("name", world_names())
def test_built_in_worlds_keep_their_plans(name: str) -> None:
    """Walls, furniture and ways are those of a world without doors."""
    world = loaded(name)
    assert room_on(world, Circumstances()) is world.room
    for day in (0, 20):
        room = room_on(world, Circumstances(lived_in=True, day=day))
        plain = room_on(world, Circumstances(day=day))
        names = [block.name for block in plain.blocks]
        assert [block.name for block in room.blocks][: len(names)] == names
        assert (room.outline_m == world.room.outline_m).all()
        assert room.walls == world.room.walls


@pytest.mark.parametrize("name", world_names())
def test_no_door_of_a_built_in_world_is_ever_in_the_way(name: str) -> None:
    """Nor in that of a query; the ways of the world itself are looked at as it is read."""
    asking = PEOPLE.asking_place(loaded(name), 1)
    for day in (0, 20):
        room = doors.with_doors(asking.room, asking.doors, asking.ways_m, day)
        assert fault_of_route(room, asking.route_m, closed=True) is None


def test_rooms_and_stores_have_doors_and_one_store_is_walked_into() -> None:
    counts = {name: len(loaded(name).doors) for name in world_names()}
    assert counts == {
        "concourse": 0, "hall": 0, "lab": 1, "living_room": 1, "lounge": 1, "mall": 13,
        "office": 2, "studio": 1,
    }  # fmt: skip
    mall = loaded("mall")
    walked = [d.name for d in mall.doors if any(doors.leads_through(w, d) for w in mall.ways_m)]
    assert walked == ["pharmacy door"]


FLAT = """
name = "flat"
size_m = [8.0, 4.0, 2.5]
reflection = [0.8, 0.8, 0.8, 0.8, 0.5, 0.7]
seed = 3
route_m = [[0.8, 0.8], [2.2, 0.8], [2.2, 3.2], [0.8, 3.2]]

[[partition]]
name = "south"
from_m = [3.0, 0.0]
to_m = [3.0, 1.5]

[[partition]]
name = "north"
from_m = [3.0, 2.5]
to_m = [3.0, 4.0]

[[furniture]]
name = "shelf"
corner_m = [5.0, 0.0, 0.0]
size_m = [0.4, 0.5, 1.8]

[[door]]
name = "inner"
from_m = [3.0, 1.5]
to_m = [3.0, 2.5]
open_deg = -80.0
material = "glass"

[[door]]
name = "exit"
from_m = [7.9, 0.0]
to_m = [6.1, 0.0]
open_deg = -90.0
leaves = 2
height_m = 2.0
"""


def parsed(text: str) -> World:
    return parse_world(text, "flat.toml")


def test_doors_come_out_as_written() -> None:
    inner, leaving = parsed(FLAT).doors
    assert (inner.name, inner.surface.name, inner.leaves) == ("inner", "glass", 1)
    assert (inner.from_m.tolist(), inner.to_m.tolist()) == ([3.0, 1.5], [3.0, 2.5])
    assert (inner.height_m, inner.open_rad) == (2.1, pytest.approx(np.deg2rad(-80)))
    assert (leaving.surface.name, leaving.leaves, leaving.height_m) == ("door", 2, 2.0)


def test_a_door_is_as_high_as_the_ceiling_at_most() -> None:
    low = FLAT.replace("[8.0, 4.0, 2.5]", "[8.0, 4.0, 2.0]")
    assert parsed(low).doors[0].height_m == 2.0


@pytest.mark.parametrize(
    ("old", "new", "mark", "complaint"),
    [
        ("to_m = [6.1, 0.0]", "to_m = [3.5, 0.0]", "to_m = [3.5", "wanted 0.4 to 2; move an end"),
        ("to_m = [6.1, 0.0]", "to_m = [7.5, 0.0]", "to_m = [7.5", "its leaf is 0.20 m wide"),
        ('name = "exit"', 'name = "inner"', 'name = "inner"\nfrom_m = [7.9', "is taken; give each"),
        ("to_m = [3.0, 2.5]\nopen", "to_m = [3.0, 2.2]\nopen", "from_m = [3.0, 1.5]",
         "'inner' ends at [3.0, 2.2], 0.15 m or more from any wall or piece; move that end"),
        ("from_m = [3.0, 1.5]\nto_m = [3.0, 2.5]", "from_m = [3.0, 0.3]\nto_m = [3.0, 1.3]",
         "from_m = [3.0, 0.3]", '"south", which has no opening there'),
        ("open_deg = -90.0", "open_deg = 90.0", "from_m = [7.9", "opens into a wall; turn it"),
        ("from_m = [7.9, 0.0]\nto_m = [6.1, 0.0]", "from_m = [6.8, 0.0]\nto_m = [5.2, 0.0]",
         "from_m = [6.8", 'opens into "shelf"; turn it the other way'),
        ("open_deg = -80.0", "open_deg = 80.0", "route_m", 'meets "inner leaf 1"; keep 0.25 m off'),
    ],
)  # fmt: skip
def test_doors_that_cannot_be_are_refused(old: str, new: str, mark: str, complaint: str) -> None:
    wrong = FLAT.replace(old, new, 1)
    assert wrong != FLAT
    with pytest.raises(InputError) as refusal:
        parsed(wrong)
    line = wrong[: wrong.rindex(mark)].count("\n") + 1
    assert str(refusal.value).startswith(f"flat.toml line {line}")
    assert complaint in str(refusal.value)
    assert "\n" not in str(refusal.value)

"""World files: round numbers come out as written, and every mistake is named with its line."""

import re
from pathlib import Path

import numpy as np
import numpy.testing as npt
import pytest
from planted_blocks import loaded

from elfslam.base.errors import InputError
from elfslam.base.grid import in_ring
from elfslam.world import toml_tables
from elfslam.world.room import Room, standing_room
from elfslam.world.toml_tables import Table, read_table
from elfslam.world.world_file import World, in_state, load_world, parse_world, world_names

BOX = """
name = "closet"
size_m = [6.0, 4.0, 2.5]
reflection = [0.8, 0.81, 0.82, 0.83, 0.5, 0.7]
seed = 3
route_m = [[0.8, 0.8], [5.2, 0.8], [5.2, 3.2], [0.8, 3.2]]
spots = [[0.8, 0.8], [5.2, 3.2]]

[[furniture]]
name = "stool"
corner_m = [1.8, 1.3, 0.0]
size_m = [0.4, 0.6, 0.5]
material = "sofa"

[[furniture]]
name = "shelf"  # hangs on the wall
corner_m = [2.0, 3.8, 1.9]
size_m = [1.0, 0.2, 0.3]
turn_deg = 0.0
clutter_per_m2 = 2.0

[[partition]]
name = "screen"
from_m = [3.0, 1.5]
to_m = [4.0, 1.5]
height_m = 1.5
thickness_m = 0.05
material = "fabric partition"

[[state]]
name = "tidied"
moved = [{ name = "stool", by_m = [1.0, 0.2], turn_deg = 90.0 }]
removed = ["screen"]

[people]
routes_m = [[[0.8, 2.4], [4.8, 2.4]]]
speed_mps = 0.9

[climate]
temperature_c = 18.0
humidity_percent = 60.0

[[access_point]]
bssid = "router"
position_m = [5.5, 3.5, 2.0]

[magnetic]
north_deg = 30.0

[[power_line]]
name = "sockets"
from_m = [0.0, 0.0, 0.3]
to_m = [4.0, 0.0, 0.3]
current_a = [1.0, 0.1]
"""

POLYGON = """
name = "corner"
outline_m = [[0.0, 0.0], [0.0, 6.0], [3.0, 6.0], [3.0, 3.0], [8.0, 3.0], [8.0, 0.0]]
height_m = 3.0
seed = 1
route_m = [[1.0, 1.0], [7.0, 1.0], [7.0, 2.0], [2.0, 2.0], [2.0, 5.0], [1.0, 5.0]]
spots = { from_m = [1.0, 1.0], to_m = [1.3, 1.2], spacing_m = 0.1 }

[surfaces]
walls = ["brick", "glass", "plaster", "door", "curtain", "concrete"]
floor = "carpet"
ceiling = { name = "foam", absorption = 0.9, scattering = 0.25 }

[[furniture]]
name = "table"
corner_m = [4.0, 2.5, 0.0]
size_m = [0.5, 0.4, 0.7]
repeat = [2, 1]
spacing_m = [1.0, 0.0]
"""


def parsed(text: str) -> World:
    return parse_world(text, "mine.toml")


@pytest.fixture(scope="module")
def closet() -> World:
    return parsed(BOX)


@pytest.fixture(scope="module")
def corner() -> World:
    return parsed(POLYGON)


def test_a_box(closet: World) -> None:
    room = closet.room
    assert (closet.name, room.height_m, room.seed) == ("closet", 2.5, 3)
    assert room.outline_m.tolist() == [[0, 0], [6, 0], [6, 4], [0, 4]]
    south, east, north, west = (wall.reflection for wall in room.walls)
    assert (west, east, south, north) == pytest.approx((0.8, 0.81, 0.82, 0.83))
    assert room.floor.reflection == pytest.approx(0.5)
    assert room.ceiling.reflection == pytest.approx(0.7)
    assert room.floor.scattering == 0.0
    assert closet.route_m.shape == (4, 2)
    assert closet.spots_m.tolist() == [[0.8, 0.8], [5.2, 3.2]]


def test_pieces_of_furniture_and_partitions(closet: World) -> None:
    stool, shelf, screen = closet.room.blocks
    assert stool.surface.name == "sofa"
    npt.assert_allclose(stool.centre_m, [2.0, 1.6])
    assert (shelf.base_m, shelf.top_m, shelf.clutter_per_m2) == (1.9, pytest.approx(2.2), 2.0)
    assert shelf.surface.name == "wood panel"
    assert (screen.name, screen.clutter_per_m2, screen.top_m) == ("screen", 0.0, 1.5)
    wanted = [[3.0, 1.475], [4.0, 1.475], [4.0, 1.525], [3.0, 1.525]]
    npt.assert_allclose(screen.corners_m, wanted)


def test_a_state_moves_turns_and_removes(closet: World) -> None:
    tidied = in_state(closet, "tidied")
    stool, shelf = tidied.room.blocks
    assert (stool.name, shelf.name) == ("stool", "shelf")
    npt.assert_allclose(stool.centre_m, [3.0, 1.8])
    assert stool.turn_rad == pytest.approx(np.pi / 2)
    assert shelf is closet.room.blocks[1]
    assert len(closet.room.blocks) == 3, "the world itself stays as it was"
    with pytest.raises(InputError, match="state 'burnt': world 'closet' has tidied; choose"):
        in_state(closet, "burnt")


def test_people_climate_and_surroundings(closet: World) -> None:
    assert closet.people.speed_mps == 0.9
    assert [route.tolist() for route in closet.people.routes_m] == [[[0.8, 2.4], [4.8, 2.4]]]
    assert (closet.climate.temperature_c, closet.climate.humidity_percent) == (18.0, 60.0)
    assert [point.bssid for point in closet.surroundings.access_points] == ["router"]
    assert closet.surroundings.field is not None
    assert closet.surroundings.power_lines[0].current_a.tolist() == [1.0, 0.1]


def test_what_may_be_left_out() -> None:
    bare = parsed(BOX.partition("spots")[0].replace("seed", "furniture_seed"))
    assert bare.room.blocks == ()
    assert bare.room.seed == 3
    assert (len(bare.spots_m), dict(bare.states), bare.people.routes_m) == (0, {}, ())
    assert (bare.climate.temperature_c, bare.climate.humidity_percent) == (None, 50.0)
    assert bare.surroundings.access_points == ()


def test_a_clockwise_polygon_keeps_materials_with_their_sides(corner: World) -> None:
    room = corner.room
    ends = np.roll(room.outline_m, -1, axis=0)
    sides = zip(room.outline_m, ends, room.walls, strict=True)
    middles = {wall.name: ((a + b) / 2).tolist() for a, b, wall in sides}
    assert middles == {
        "brick": [0.0, 3.0], "glass": [1.5, 6.0], "plaster": [3.0, 4.5], "door": [5.5, 3.0],
        "curtain": [8.0, 1.5], "concrete": [4.0, 0.0],
    }  # fmt: skip
    assert in_ring(room.outline_m, np.array([[1.0, 5.0], [5.0, 5.0]])).tolist() == [True, False]
    assert (room.ceiling.name, room.ceiling.absorption, room.ceiling.scattering) == (
        "foam", 0.9, 0.25,
    )  # fmt: skip


def test_rows_of_the_same_and_grids_of_spots(corner: World) -> None:
    assert [block.name for block in corner.room.blocks] == ["table 1", "table 2"]
    step = corner.room.blocks[1].centre_m - corner.room.blocks[0].centre_m
    assert step.tolist() == [1.0, 0.0]
    assert corner.spots_m.shape == (12, 2)
    npt.assert_allclose(corner.spots_m[[0, 1, 4, -1]], [[1, 1], [1.1, 1], [1, 1.1], [1.3, 1.2]])


def reflections(room: Room) -> list[float]:
    return [round(side.reflection, 9) for side in (*room.walls, room.floor, room.ceiling)]


def test_the_evaluation_worlds_stay_as_they_are() -> None:
    living_room, office = loaded("living_room"), loaded("office")
    assert living_room.room.size_m.tolist() == [10.0, 6.0, 2.7]
    assert office.room.size_m.tolist() == [24.0, 15.0, 3.0]
    assert reflections(living_room.room) == [0.78, 0.84, 0.87, 0.86, 0.55, 0.85]
    assert reflections(office.room) == [0.80, 0.86, 0.83, 0.84, 0.50, 0.60]
    assert living_room.route_m[[0, -1]].tolist() == [[1.3, 1.2], [1.2, 3.0]]
    assert office.route_m[[0, -1]].tolist() == [[2.0, 2.0], [1.8, 7.0]]
    assert (len(living_room.room.blocks), len(office.room.blocks)) == (8, 6)


def area_m2(room: Room) -> float:
    x, y = room.outline_m.T
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


@pytest.mark.parametrize(
    ("name", "size_m2", "blocks", "spots", "states"),
    [
        ("living_room", 60, 8, 0, 1),
        ("office", 360, 6, 0, 1),
        ("studio", 52, 6, 0, 1),
        ("lounge", 55.9, 5, 0, 1),
        ("concourse", 848, 21, 0, 1),
        ("mall", 2004, 79, 0, 2),
        ("lab", 448, 116, 128, 2),
        ("hall", 643.5, 34, 4000, 2),
    ],
)
def test_a_built_in_world_can_be_walked(
    name: str, size_m2: float, blocks: int, spots: int, states: int
) -> None:
    world = loaded(name)
    assert world.name == name
    assert area_m2(world.room) == pytest.approx(size_m2)
    assert (len(world.room.blocks), len(world.spots_m)) == (blocks, spots)
    assert len(world.states) == states
    walked = np.vstack(np.linspace(world.route_m, np.roll(world.route_m, -1, axis=0), 100))
    for room in (world.room, *world.states.values()):
        assert standing_room(room, walked).all()
        assert room.is_free(walked, 1.2, 0.25).all()
    assert standing_room(world.room, world.spots_m).all()


def test_each_state_moves_five_pieces() -> None:
    for name in world_names():
        world = loaded(name)
        for state in world.states.values():
            here = {block.name: block for block in world.room.blocks}
            moved = [block for block in state.blocks if block is not here[block.name]]
            assert len(moved) >= 5


def test_a_world_from_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(BOX, encoding="utf-8")
    assert load_world(str(path)).name == "closet"


def test_the_example_of_the_manual_is_a_world() -> None:
    manual = Path(__file__).parents[2] / "docs" / "how-to" / "own_world.md"
    manual = manual.read_text(encoding="utf-8")
    example = re.search(r'```toml\n(name = "kitchen".*?)```', manual, re.S)
    world = parsed(example[1])
    assert (len(world.room.walls), list(world.states)) == (6, ["party"])


@pytest.mark.parametrize("name", ["garage", "", "../world", "no/such/file.toml"])
def test_an_unknown_world_is_refused_with_the_known_ones(name: str) -> None:
    with pytest.raises(InputError, match=f"wanted {', '.join(world_names())} or a TOML file"):
        load_world(name)


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xff\xfe\x00name")
    with pytest.raises(InputError, match=r"mine\.toml: is no text in UTF-8"):
        load_world(str(path))


def assert_refused(text: str, old: str, new: str, mark: str, complaint: str) -> None:
    """The planted text is refused by a line that holds `mark`, in one line with `complaint`."""
    assert old in text
    broken = text.replace(old, new, 1)
    line = broken[: broken.index(mark)].count("\n") + 1
    with pytest.raises(InputError) as refusal:
        parsed(broken)
    message = str(refusal.value)
    assert message.startswith(f"mine.toml line {line}"), message
    assert complaint in message, message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("old", "new", "mark", "complaint"),
    [
        # at the top
        ("size_m = [6", "size_m = [6 6", "size_m", "no TOML"),
        ('name = "closet"', "name = 7", "name = 7", "name is 7, wanted a text in quotes"),
        ("seed = 3", "sead = 3", "sead", "knows no 'sead'; wanted name,"),
        ("seed = 3", "seed = 3\nfurniture_seed = 3", "furniture_seed", "the older name of seed"),
        ("[6.0, 4.0, 2.5]", "[6.0, -4.0, 2.5]", "size_m", "wanted 3 numbers from 0.01 to 500"),
        ("[6.0, 4.0, 2.5]", "[6.0, 4.0, 1.9]", "size_m", "the ceiling is 1.9 m high, wanted 2 m"),
        ("size_m = [6.0, 4.0, 2.5]\n", "", "\n", "wanted either size_m or outline_m"),
        ("reflection = [0.8, 0.81, 0.82, 0.83, 0.5, 0.7]\n", "", "\n", "[surfaces] or reflection"),
        # furniture and partitions
        ('name = "stool"\n', "", "[[furniture]]", "furniture 1: lacks name"),
        ('name = "shelf"', 'name = "stool"', 'name = "stool"  #', "the name 'stool' is taken"),
        ('name = "screen"', 'name = "shelf"', 'name = "shelf"\nfrom', 'partition 1 "shelf": the'),
        ('"sofa"', '"soda"', '"soda"', "furniture 1 \"stool\": material: material 'soda'"),
        ("[1.8, 1.3, 0.0]", "[5.8, 1.3, 0.0]", "[5.8, 1.3", "'stool' stands outside the room"),
        ("turn_deg = 0.0", "turn_deg = 30.0", "corner_m = [2.0", "'shelf' stands outside the room"),
        ("turn_deg = 0.0", "repeat = [2, 1]", '[[furniture]]\nname = "shelf"', "lacks spacing_m"),
        ("= 2.0\n", '= "2"\n', "clutter", "clutter_per_m2 is '2', wanted a number from 0 to 100"),
        ("to_m = [4.0, 1.5]", "to_m = [3.0, 1.5]", "to_m = [3.0", "begins where it ends"),
        ("height_m = 1.5", "height_m = 3.0", "[[partition]]", "'screen' reaches from 0 to 3 m"),
        # ways that nobody can walk
        ("[5.2, 3.2], [0.8, 3.2]]", "[5.2, 4.2], [0.8, 3.2]]", "route_m", "the outside of the"),
        ("[5.2, 3.2], [0.8, 3.2]]", "[5.9, 3.2], [0.8, 3.2]]", "route_m", "leg 2 from [5.2, 0.8]"),
        ("[5.2, 3.2], [0.8, 3.2]]", "[2.0, 3.2]]", "route_m", "leg 2 from [5.2, 0.8] to [2.0"),
        ("[5.2, 3.2], [0.8, 3.2]]", "[5.2, 3.2]]", "route_m", 'meets "stool"; keep 0.25 m off'),
        ("[[0.8, 0.8], [5.2, 0.8]", "[[0.8], [5.2, 0.8]", "route_m", "point 1 is [0.8], wanted"),
        ("route_m = [[0.8, 0.8], [5.2, 0.8], [5.2, 3.2], [0.8, 3.2]]",
         "route_m = [[0.8, 0.8], [0.8, 0.8]]", "route_m", "fewer than 2 distinct corners"),
        ("route_m = [[0.8, 0.8], [5.2, 0.8], [5.2, 3.2], [0.8, 3.2]]",
         "route_m = [[0.8, 0.8], [1.3, 0.8]]", "route_m", "is 1.00 m long, wanted 2 m or more"),
        ("route_m = [[0.8, 0.8], [5.2, 0.8], [5.2, 3.2], [0.8, 3.2]]",
         "route_m = 4", "route_m", "route_m is 4, wanted a list of [x, y]"),
        ("[[[0.8, 2.4], [4.8, 2.4]]]", "[[[0.8, 1.5], [4.8, 1.5]]]", "routes_m", "people: route 1"),
        ("spots = [[0.8, 0.8]", "spots = [[2.0, 1.5]", "spots", "spot 1 at [2.0, 1.5] is in a"),
        # states
        ('{ name = "stool"', '{ name = "stol"', "moved", "moved: there is no 'stol'; did you mean"),
        ('["screen"]', '["stool"]', "moved", "'stool' is moved or removed before"),
        ("by_m = [1.0", "by_m = [5.0", "moved", "moved 1: 'stool' stands outside the room"),
        ("by_m = [1.0, 0.2]", "by_m = [0.0, -0.5]", "[[state]]", "route_m: leg 1 from"),
        ("[[state]]", "[state]", "[state]", "state: wanted [[state]] tables"),
        # climate and surroundings
        ("temperature_c = 18.0", "temperature_c = 95.0", "temperature_c", "from -20 to 50"),
        ("[5.5, 3.5, 2.0]", "[5.5, 3.5]", "[[access_point]]", "access_point 'router': "),
        ("north_deg = 30.0", 'north_deg = "up"', "[magnetic]", "magnetic: north_deg is 'up'"),
        ("[1.0, 0.1]", "[]", "[[power_line]]", "power_line 'sockets': current_a has to be"),
    ],
)  # fmt: skip
def test_mistakes_are_refused(old: str, new: str, mark: str, complaint: str) -> None:
    assert_refused(BOX, old, new, mark, complaint)


def test_nobody_walks_under_a_table_but_under_a_high_shelf() -> None:
    """The stool of 0.5 m is in the way; a shelf from 1.9 m is not, one from 1.7 m is."""
    under = ("[5.2, 3.2], [0.8, 3.2]]", "[5.2, 3.7], [0.8, 3.7]]")
    assert parsed(BOX.replace(*under).replace("[[0.8, 0.8], [5.2, 3.2]]", "[]"))
    assert_refused(BOX.replace("3.8, 1.9]", "3.8, 1.7]"), *under, "route_m", 'meets "shelf"')


def test_states_need_names_of_their_own_and_something_to_do() -> None:
    again = '[[state]]\nname = "tidied"\nremoved = ["stool"]\n\n[people]'
    assert_refused(BOX, "[people]", again, 'name = "tidied"\nremoved', "the name 'tidied' is taken")
    idle = '[[state]]\nname = "idle"\n\n[people]'
    assert_refused(BOX, "[people]", idle, '[[state]]\nname = "idle"', "neither moves nor removes")


@pytest.mark.parametrize(
    ("old", "new", "mark", "complaint"),
    [
        ("[8.0, 3.0], [8.0, 0.0]]", "[8.0, 0.0], [8.0, 3.0]]", "outline_m", "crosses side"),
        ("[8.0, 0.0]]", "[8.0, 0.0], [0.0, 0.0]]", "outline_m", "the outline closes by itself"),
        ("[3.0, 6.0], [3.0, 3.0]", "[3.0, 6.0], [3.0, 6.0]", "outline_m", "are one place"),
        ("[[0.0, 0.0], [0.0, 6.0], [3.0, 6.0], [3.0, 3.0], [8.0, 3.0], [8.0, 0.0]]",
         "[[0.0, 0.0], [8.0, 0.0]]", "outline_m", "wanted at least 3 corners, got 2"),
        ("[[0.0, 0.0], [0.0, 6.0], [3.0, 6.0], [3.0, 3.0], [8.0, 3.0], [8.0, 0.0]]",
         "[[0.0, 0.0], [4.0, 0.0], [8.0, 0.0]]", "outline_m", "encloses 0 m2, wanted 1 or more"),
        ("[8.0, 3.0], [8.0, 0.0]]", "[8.0, 3.0], [8.0, -2.0], [8.0, 0.0]]", "outline_m",
         "side 5 from [8.0, 3.0] to [8.0, -2.0] crosses"),
        ('"brick", ', "", "walls", "walls has 5 materials, wanted one or 6"),
        ('floor = "carpet"', "", "[surfaces]", "floor is None, wanted the name of a material"),
        ("to_m = [1.3, 1.2]", "to_m = [0.3, 1.2]", "spots", "ends before it begins"),
        ("from_m = [1.0, 1.0]", "from_m = [0.2, 1.0]", "spots", "spot 1 at [0.2, 1.0] is in a"),
        ("repeat = [2, 1]", "repeat = [6, 1]", "[4.0, 2.5", "'table 5' stands outside the room"),
    ],
)  # fmt: skip
def test_mistakes_of_polygons_are_refused(old: str, new: str, mark: str, complaint: str) -> None:
    assert_refused(POLYGON, old, new, mark, complaint)


STOOL = '[[furniture]]\nname = "stool"'
BOXES = """[[furniture]]
name = "box"
corner_m = [0.1, 0.1, 0.0]
size_m = [0.1, 0.1, 0.1]
repeat = [20, 40]
spacing_m = [0.001, 0.001]
"""
ROUTE = "route_m = [[0.8, 0.8], [5.2, 0.8], [5.2, 3.2], [0.8, 3.2]]"


def a_circle(corners: int) -> list[list[float]]:
    turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
    return np.column_stack([3 + 2 * np.cos(turn), 2 + np.sin(turn)]).tolist()


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        (ROUTE, f"route_m = {a_circle(1001)}", "route_m has 1001, wanted 1000 at most"),
        ("spots = [[0.8, 0.8], [5.2, 3.2]]", f"spots = {[[1, 1]] * 100_001}", "spots has 100001"),
        ("routes_m = [[[0.8, 2.4], [4.8, 2.4]]]", f"routes_m = {[[[1, 1]]] * 1001}", "has 1001"),
        ('removed = ["screen"]', f"removed = {['screen'] * 1001}", "removed has 1001"),
        (STOOL, '[[state]]\nname = "x"\n' * 1001 + STOOL, "state has 1002, wanted 1000"),
        (STOOL, STOOL + "\nrepeat = [200, 200]\nspacing_m = [0.01, 0.01]", "more than 1000 pieces"),
        ('bssid = "router"', 'bssid = "a"\n[[access_point]]\n' * 1001, "access_point has 1002"),
        (STOOL, f"{BOXES}\n{STOOL}", "too many together"),
    ],
)
def test_more_than_anybody_draws_is_refused_at_once(old: str, new: str, complaint: str) -> None:
    assert old in BOX
    text = BOX.replace(ROUTE, f"route_m = {a_circle(900)}") if new.startswith(BOXES) else BOX
    with pytest.raises(InputError, match=complaint):
        parsed(text.replace(old, new, 1))


def test_an_outline_of_countless_corners_is_refused_at_once() -> None:
    size = "size_m = [6.0, 4.0, 2.5]"
    with pytest.raises(InputError, match="outline_m has 201, wanted 200 at most"):
        parsed(BOX.replace(size, f"outline_m = {a_circle(201)}\nheight_m = 2.5"))


TEXT = """\
# a comment = 1
name = "x"
corners = [
  [1.0, 2.0],
  [3.0, 4.0],
]
climate.warm = 3

[one] # header
value = 7
"quoted" = 2

[[many]]
name = "first"
value = 1

[[many]]

value = 2
"""


@pytest.fixture
def top() -> Table:
    return read_table(TEXT, "x.toml")


def line_of(given: Table, key: str = "") -> int:
    return int(str(given.refusal("wrong", key)).split()[2].strip(":,"))


def test_every_key_has_its_line(top: Table) -> None:
    assert [line_of(top, key) for key in ("", "name", "corners", "climate", "one")] == [
        1, 2, 3, 7, 9,
    ]  # fmt: skip
    one = toml_tables.table(top, "one")
    assert [line_of(one, key) for key in ("", "value", "quoted", "missing")] == [9, 10, 11, 9]
    first, second = toml_tables.tables(top, "many")
    assert [line_of(first), line_of(first, "name"), line_of(first, "value")] == [13, 14, 15]
    assert [line_of(second), line_of(second, "value")] == [17, 19]
    assert (first.label, second.label) == ('many 1 "first"', "many 2")


def test_tables_without_headers_get_the_line_of_their_key() -> None:
    top = read_table('x = 1\nmany = [{ name = "a" }, { name = "b" }]\none = { y = 2 }\n', "f")
    assert [line_of(item) for item in toml_tables.tables(top, "many")] == [2, 2]
    assert line_of(toml_tables.table(top, "one"), "y") == 3


@pytest.mark.parametrize("value", ["inf", "nan", "true", '"7"', "[7]", "-501", "501"])
def test_what_is_no_number_of_metres_is_refused(value: str) -> None:
    with pytest.raises(InputError, match=r"^f line 2: x is .*, wanted a number from -500 to 500"):
        toml_tables.number(read_table(f"\nx = {value}", "f"), "x")


def test_a_missing_value_and_an_unknown_key_are_refused(top: Table) -> None:
    with pytest.raises(InputError, match=r"^x\.toml line 17, many 2: lacks name; add it"):
        toml_tables.text(toml_tables.tables(top, "many")[1], "name")
    with pytest.raises(InputError, match=r"line 11, one: knows no 'quoted'; .* mean 'quote'"):
        toml_tables.check_keys(toml_tables.table(top, "one"), ("value", "quote"))
    with pytest.raises(InputError, match="line 11, one: knows no 'quoted'; wanted value; remove"):
        toml_tables.check_keys(toml_tables.table(top, "one"), ("value",))


@pytest.mark.parametrize(
    ("text", "line"), [("x = 1\ny = = 2\n", 2), ("x = 1\n\nx = 2\n", 3), ("x = [1,", 1)]
)
def test_what_is_no_toml_is_refused_with_its_line(text: str, line: int) -> None:
    with pytest.raises(InputError, match=f"^f line {line}: is no TOML") as refusal:
        read_table(text, "f")
    assert "\n" not in str(refusal.value)

"""Buildings: one motion over several floors, pressure, sound by room, and levels in the truth."""

from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import ElfslamError, InputError, ParameterError
from elfslam.base.values import LevelPassage, Recording, Truth
from elfslam.world import barometer
from elfslam.world import building as buildings
from elfslam.world.building import MultiFloorWorld, building_names, load_place, parse_building
from elfslam.world.building_walk import BuildingWalk, course_of, levels_of, walk_through
from elfslam.world.imu import GRAVITY_MPS2
from elfslam.world.kinds import PEOPLE
from elfslam.world.passages import RISE_M, Gait
from elfslam.world.simulate import simulate
from elfslam.world.simulate_building import simulate_building, simulate_place, usual_day
from elfslam.world.stroll import random_person
from elfslam.world.walker import KINEMATICS_RATE_HZ, Motion, random_walker
from elfslam.world.world_file import World, load_world

STOREY_M = 3.4
ROOM = """
name = "room"
size_m = [16.0, 6.0, 3.0]
reflection = [0.8, 0.8, 0.8, 0.8, 0.5, 0.7]
seed = 7
route_m = [[1.5, 1.0], [14.5, 1.0], [14.5, 5.0], [1.5, 5.0]]

[[furniture]]
name = "table"
corner_m = [3.0, 2.2, 0.0]
size_m = [2.0, 1.4, 0.8]

[[state]]
name = "moved"
moved = [{ name = "table", by_m = [1.0, 0.2] }]
"""
FLOOR = """
[[floor]]
level = {level}
height_m = {height}
world = "room.toml"
"""
HOUSE = 'name = "house"\nplan = [0, 1, 0]\n' + "".join(
    FLOOR.format(level=level, height=STOREY_M * level) for level in range(3)
)
STAIRS = """
[[passage]]
name = "west stairs"
kind = "stairs"
levels = [0, 1, 2]
at_m = [0.0, 3.0]
heading_deg = 180.0
"""
ESCALATOR = """
[[passage]]
name = "escalator"
kind = "escalator"
levels = [0, 1]
at_m = [6.0, 3.0]
to_m = [13.0, 3.0]
"""
LIFT = """
[[passage]]
name = "lift"
kind = "lift"
levels = [0, 1, 2]
at_m = [16.0, 3.0]
heading_deg = 0.0
speed_mps = 1.0
"""
MALL_ACCEL = [[-0.74279004, 7.44162335, 13.43746055], [0.02891642, 2.10348228, 4.92313115]]
MALL_TRUTH = [[13.14194284, 7.12573792, -0.00606053], [40.22164808, 18.23019267, 1.57363723]]
PASSAGES = {"stairs": STAIRS, "escalator": ESCALATOR, "lift": LIFT}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("building")
    (made / "room.toml").write_text(ROOM, encoding="utf-8")
    return made


def house(folder: Path, *kinds: str) -> MultiFloorWorld:
    return parse_building(HOUSE + "".join(PASSAGES[kind] for kind in kinds), "house.toml", folder)


def gone(building: MultiFloorWorld, seed: int, *, strays: bool = False) -> BuildingWalk:
    generator = np.random.default_rng([seed, 1])
    course = course_of(building, building.plan, 1, generator)
    someone = random_person(generator, 0.3) if strays else random_walker(generator)
    return walk_through(someone, course, generator)


def moments(walk: BuildingWalk, gait: Gait) -> F64:
    """Where a walk goes in this manner, as stretches of rows (k, 2)."""
    numbers = [k for k, each in enumerate(walk.stretches) if each.gait is gait]
    rows = [np.flatnonzero(walk.stretch == number)[[0, -1]] for number in numbers]
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def middle_of(rows: F64, values: F64) -> list[float]:
    return [float(np.mean(values[int(a) : int(b)])) for a, b in rows]


@cache
def built_in(name: str) -> MultiFloorWorld:
    place = load_place(name)
    return place


@lru_cache(maxsize=4)
def silent(name: str, seed: int, walker: str = "surveyor") -> tuple[Recording, Truth]:
    return simulate_building(built_in(name), seed, rounds=1, sound=False, walker=walker)


@pytest.mark.parametrize("kind", PASSAGES)
@pytest.mark.parametrize("strays", [False, True])
def test_height_gained_is_that_of_the_floors(folder: Path, kind: str, *, strays: bool) -> None:
    walk = gone(house(folder, kind), 100, strays=strays)
    height_m = middle_of(moments(walk, Gait.WALK), walk.motion.position_m[:, 2])
    assert np.diff(height_m) == pytest.approx([STOREY_M, -STOREY_M], abs=0.1)
    climbed = walk.ground_m[[0, -1]]
    assert climbed == pytest.approx([0.0, 0.0], abs=1e-9)
    assert (walk.ground_m.min(), walk.ground_m.max()) == pytest.approx((0.0, STOREY_M), abs=1e-6)


@pytest.mark.parametrize("kind", PASSAGES)
@pytest.mark.parametrize("strays", [False, True])
def test_position_is_continuous_and_speed_bounded(folder: Path, kind: str, *, strays: bool) -> None:
    motion = gone(house(folder, kind), 101, strays=strays).motion
    speed = np.linalg.norm(np.diff(motion.position_m, axis=0), axis=1) * KINEMATICS_RATE_HZ
    assert speed.max() < 2.5
    assert np.abs(np.diff(motion.heading_rad)).max() * KINEMATICS_RATE_HZ < 7.0


def test_each_step_of_stairs_is_a_footstep(folder: Path) -> None:
    walk = gone(house(folder, "stairs"), 102)
    steps = round(STOREY_M / 2 / RISE_M)
    for gait in (Gait.UP, Gait.DOWN):
        rows = moments(walk, gait).astype(int)
        assert np.diff(walk.motion.steps[rows]).ravel() == pytest.approx([steps] * 2, abs=0.7)
        rises = np.diff(walk.ground_m[rows]).ravel()
        assert np.abs(rises) == pytest.approx([STOREY_M / 2] * 2, abs=0.1)


@pytest.mark.parametrize(("kind", "gait"), [("lift", Gait.LIFT), ("escalator", Gait.RIDE)])
def test_whoever_rides_takes_no_step(folder: Path, kind: str, gait: Gait) -> None:
    """And an escalator goes at 0.5 m/s along its flat ends and its incline."""
    walk = gone(house(folder, kind), 104)
    rows = moments(walk, gait).astype(int)
    assert len(rows) >= 2
    for a, b in rows:
        quiet = slice(a + 600, max(b - 600, a + 601))
        assert np.ptp(walk.motion.steps[quiet]) < 0.05
    if kind == "escalator":
        incline_m = STOREY_M / np.sin(np.deg2rad(30.0))
        flat_m = 7.0 - STOREY_M / np.tan(np.deg2rad(30.0))
        for ride in rows.reshape(-1, 4, 2):
            lasted_s = np.ptp(ride) / KINEMATICS_RATE_HZ
            assert lasted_s == pytest.approx((incline_m + flat_m) / 0.5, rel=0.1)


def test_the_accelerometer_feels_a_lift_start_and_stop(folder: Path) -> None:
    recording, truth = simulate_building(house(folder, "lift"), 105, rounds=1, sound=False)
    felt = np.linalg.norm(recording.imu.accel_mps2, axis=1)
    standing = (recording.imu.t_s > 0.3) & (recording.imu.t_s < 1.5)
    mean = np.convolve(felt, np.full(60, 1 / 60), mode="same") - felt[standing].mean()
    start_s, end_s = truth.levels.t_s[1:3]
    ride = (recording.imu.t_s > start_s + 4.5) & (recording.imu.t_s < end_s - 2.5)
    assert mean[ride].max() == pytest.approx(0.8, abs=0.25)
    assert mean[ride].min() == pytest.approx(-0.8, abs=0.25)
    assert np.argmax(mean[ride]) < np.argmin(mean[ride])


def test_people_keep_to_the_middle_of_stairs(folder: Path) -> None:
    walk = gone(house(folder, "stairs"), 106, strays=True)
    for a, b in moments(walk, Gait.UP).astype(int):
        across_m = np.abs(walk.motion.position_m[a:b, 1] - 3.0)
        assert np.abs(across_m - 0.65).max() < 0.5


@pytest.mark.parametrize("kind", PASSAGES)
def test_the_truth_knows_levels_where_doors_are_passed(folder: Path, kind: str) -> None:
    building = house(folder, kind)
    walk = gone(building, 107)
    levels = levels_of(walk)
    assert levels.passages == (None, LevelPassage(kind), None, LevelPassage(kind), None)
    np.testing.assert_equal(levels.level, [0, np.nan, 1, np.nan, 0])
    rows = np.searchsorted(walk.motion.t_s, levels.t_s)
    doors_m = walk.motion.position_m[rows[1:], :2]
    link = building.links[0]
    ends_m = np.stack([link.at_m, link.to_m if kind == "escalator" else link.at_m])
    away_m = np.linalg.norm(doors_m - ends_m[[0, 1, 1, 0]], axis=1)
    assert away_m.max() < 1.0
    on_floor = levels.at(walk.motion.t_s)
    assert np.abs(walk.ground_m - STOREY_M * on_floor)[np.isfinite(on_floor)].max() < 0.1


def test_a_plan_over_more_than_one_storey_passes_them_between_floors(folder: Path) -> None:
    building = replace(house(folder, "stairs"), plan=(0, 2, 1))
    levels = levels_of(gone(building, 108))
    np.testing.assert_equal(levels.level, [0, np.nan, 2, np.nan, 1])


@pytest.mark.parametrize("walker", ["surveyor", "person"])
@pytest.mark.parametrize("name", building_names())
def test_built_in_buildings_are_walked_as_planned(name: str, walker: str) -> None:
    recording, truth = silent(name, 100, walker)
    assert recording.barometer
    assert tuple(truth.levels.level[::2]) == built_in(name).plan
    speed = np.linalg.norm(np.diff(truth.world_from_body[:, :2], axis=0), axis=1) * 50
    assert speed.max() < 2.8
    assert np.abs(np.diff(truth.world_from_body[:, 2])).max() * 50 < 7.0


def test_every_floor_of_the_tower_is_furnished_differently() -> None:
    places = [
        {block.name: block.centre_m.round(2).tobytes() for block in storey.world.room.blocks}
        for storey in built_in("tower").storeys
    ]
    for k, here in enumerate(places):
        for there in places[:k]:
            assert sum(there.get(name) != at for name, at in here.items()) >= 20
    ground, upper = (storey.world.room for storey in built_in("mall_floors").storeys)
    assert (ground.outline_m == upper.outline_m).all()


def standing(height_m: F64, xy_m: tuple[float, float] = (0.0, 0.0)) -> Motion:
    count = len(height_m)
    position_m = np.column_stack([np.full((count, 2), xy_m), height_m])
    none = np.zeros(count)
    t_s = np.arange(count) / KINEMATICS_RATE_HZ
    return Motion(t_s, position_m, none, none, none, none, none)


def test_the_barometric_formula() -> None:
    """One scale height up it is a factor of e; here 8.6 m make one hectopascal."""
    scale_m = barometer.GAS_CONSTANT_JPKGK * barometer.INDOORS_K / GRAVITY_MPS2
    pressure = barometer.pressure_at(1000.0, np.array([0.0, scale_m, 8.61]))
    assert pressure == pytest.approx([1000.0, 1000.0 / np.e, 999.0], abs=1e-2)


def test_pressure_is_that_of_the_height(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without doors and weather nothing but noise comes on top."""
    for name, value in (("DOORS_PER_MIN", 0.0), ("WEATHER_HPAPH", 0.0), ("SLOW_HPA", 0.0)):
        monkeypatch.setattr(barometer, name, value)
    height_m = np.repeat([1.2, 1.2 + 3.4, 1.2 + 6.8], 8_000)
    read = barometer.read_barometer(standing(height_m), np.random.default_rng(3))
    assert 1 / np.diff(read.t_s).mean() == pytest.approx(barometer.RATE_HZ)
    level = np.minimum(read.t_s // 20, 2)
    means = np.array([read.pressure_hpa[level == k].mean() for k in range(3)])
    at_entrance = means[0] * np.exp(1.2 * GRAVITY_MPS2 / (287.05 * 294.15))
    assert means == pytest.approx(barometer.pressure_at(at_entrance, height_m[::8_000]), abs=0.005)
    noise = read.pressure_hpa[level == 0].std()
    assert noise == pytest.approx(barometer.NOISE_HPA, rel=0.1)


def test_a_door_makes_the_pressure_jump_and_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DOORS_PER_MIN", "WEATHER_HPAPH", "SLOW_HPA", "NOISE_HPA"):
        monkeypatch.setattr(barometer, name, 0.0)
    read = barometer.read_barometer(standing(np.ones(40_000)), np.random.default_rng(4), [40.0])
    away = np.abs(read.pressure_hpa - read.pressure_hpa[0])
    assert away[read.t_s < 39].max() < 1e-9
    assert 0.03 < away.max() <= barometer.DOOR_HPA[1]
    assert abs(read.t_s[np.argmax(away)] - 40.0) < 1.0
    assert away[-1] < 0.1 * away.max()


def test_wind_is_felt_at_entrances_on_their_floor_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DOORS_PER_MIN", "WEATHER_HPAPH", "SLOW_HPA", "NOISE_HPA"):
        monkeypatch.setattr(barometer, name, 0.0)
    scatter = []
    for x_m, height_m in ((0.0, 1.2), (40.0, 1.2), (0.0, 5.0)):
        motion = standing(np.full(40_000, height_m), (x_m, 0.0))
        entrances_m = np.array([[0.0, 0.0]])
        read = barometer.read_barometer(motion, np.random.default_rng(5), (), entrances_m)
        scatter.append(read.pressure_hpa.std())
    assert scatter == pytest.approx([barometer.GUST_HPA, 0.0, 0.0], abs=0.03)


def test_a_world_of_one_floor_has_a_barometer_too() -> None:
    recording = simulate(load_world("office"), 109, sound=False, rounds=2, sensors=["barometer"])[0]
    assert 0.1 < np.ptp(recording.barometer.pressure_hpa) < 0.8


def test_a_query_that_cuts_across_floors_still_gets_to_every_door() -> None:
    """Of seed 1100 the first way that is drawn leaves out the mall's east end, with its lift."""
    mall = load_place("mall_floors")
    _, asked = usual_day(mall, PEOPLE, 1100, asking=True)
    for storey in asked.storeys:
        for link in mall.links:
            buildings.nearest_on_route(storey, link, storey.world.route_m)
    assert any(
        len(now.world.route_m) != len(then.world.route_m)
        for now, then in zip(asked.storeys, mall.storeys, strict=True)
    )


def test_the_same_seed_gives_the_same_bytes(folder: Path) -> None:
    building = house(folder, "stairs", "lift")
    made = (simulate_building(building, seed, rounds=1, plan=(0, 1)) for seed in (110, 110, 111))
    first, again, other = (recording for recording, _ in made)
    for one, two in ((first, again), (first, other)):
        alike = one.audio.samples.tobytes() == two.audio.samples.tobytes()
        assert alike is (two is again)
        alike = one.barometer.pressure_hpa.tobytes() == two.barometer.pressure_hpa.tobytes()
        assert alike is (two is again)
    assert np.abs(first.audio.samples).max() > 0.05


def test_the_mall_of_one_floor_is_what_it_always_was() -> None:
    """Readings of this walk before there were buildings."""
    recording, truth = simulate(load_world("mall"), 77, rounds=1, sound=False)
    np.testing.assert_allclose(recording.imu.accel_mps2[[700, 9_000]], MALL_ACCEL, atol=1e-7)
    np.testing.assert_allclose(truth.world_from_body[[600, 5_000]], MALL_TRUTH, atol=1e-7)
    ground = built_in("mall_floors").storeys[0].world
    assert ground.room.outline_m.tobytes() == load_world("mall").room.outline_m.tobytes()
    assert len(ground.room.blocks) == len(load_world("mall").room.blocks)


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("level = 1", "level = 4", "one above the other"),
        ("height_m = 3.4", "height_m = 0.5", "wanted each 2 m above the last"),
        ('world = "room.toml"', 'world = "hut.toml"', "no such file beside the building"),
        ('kind = "stairs"', 'kind = "slide"', "wanted stairs, lift, escalator"),
        ("levels = [0, 1, 2]", "levels = [0, 9]", "wanted two or more of [0, 1, 2]"),
        ("levels = [0, 1, 2]", 'levels = ["low"]', "wanted levels such as 0,1,0"),
        ("at_m = [0.0, 3.0]", "at_m = [3.0, 3.0]", "move it or what stands there"),
        ("plan = [0, 1, 0]", "plan = [0, 7]", "level 7: building 'house' has 0, 1, 2"),
        ("plan = [0, 1, 0]", "plan = [0, 0]", "level 0 follows itself"),
        ("plan = [0, 1, 0]", "entrances_m = [[0]]", "point 1 is [0], wanted [x, y]"),
        ("plan = [0, 1, 0]", "plans = [0]", "did you mean 'plan'?"),
        ("to_m = [13.0, 3.0]", "to_m = [8.0, 3.0]", "5.9 m long or more; move to_m"),
    ],
)
def test_a_building_is_refused(folder: Path, old: str, new: str, complaint: str) -> None:
    text = HOUSE + STAIRS + ESCALATOR
    assert old in text
    with pytest.raises(InputError) as refusal:
        parse_building(text.replace(old, new, 1), "house.toml", folder)
    assert complaint in str(refusal.value)
    assert "\n" not in str(refusal.value)


def test_what_only_the_escalator_joins_is_refused_by_name(folder: Path) -> None:
    with pytest.raises(InputError, match="leads from level 0 to 2; pass by a level between"):
        simulate_building(house(folder, "escalator"), 1, plan=(0, 2), sound=False)


def test_what_a_building_has_not_is_refused(folder: Path) -> None:
    building = house(folder, "stairs")
    refused: tuple[tuple[dict[str, object], type[ElfslamError], str], ...] = (
        ({"walker": "dog"}, ParameterError, "wanted surveyor or person"),
        ({"sensors": ["wifi"]}, ParameterError, "of these a building has barometer alone"),
        ({"rounds": 1000}, InputError, "take more than 2 hours"),
    )
    for wish, error, complaint in refused:
        with pytest.raises(error, match=complaint):
            simulate_place(building, 1, sound=False, **wish)
    with pytest.raises(ParameterError, match="has one floor"):
        simulate_place(load_world("studio"), 1, plan=(0, 1), sound=False)


def test_an_unknown_place_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"mall, .*, mall_floors, tower or a TOML file"):
        load_place("castle")
    assert isinstance(load_place("mall"), World)


def test_a_building_of_a_file(folder: Path) -> None:
    file = folder / "house.toml"
    file.write_text(HOUSE + LIFT, encoding="utf-8")
    assert isinstance(load_place(file), MultiFloorWorld)

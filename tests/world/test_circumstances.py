"""Circumstances: each one changes what it says, reproducibly, and nothing else."""

from dataclasses import fields, replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.errors import InputError, ParameterError
from elfslam.stages.acoustic_odometry import AcousticOdometryParameters
from elfslam.world import circumstances
from elfslam.world.circumstances import DRAWN_C, Circumstances, air_on, room_on, whereabouts
from elfslam.world.device import BAND_BINS, Device, built_in_device
from elfslam.world.materials import material
from elfslam.world.phone import air_at, ends_of, poses_at
from elfslam.world.pulses import Air, speed_of_sound_mps
from elfslam.world.room import Block, Room, box, shoebox
from elfslam.world.scene import scene_of
from elfslam.world.world_file import Climate, People, World, load_world

AISLE_M = np.array([[2.0, 2.0], [18.0, 2.0], [18.0, 12.0]])
"""An open route of 26 m; its ends are 18.9 m apart."""


def hall(count: int = 300) -> World:
    """A hall of 20 by 14 m: `count` stools and desks, a cupboard, a partition and a wall stool."""
    generator = np.random.default_rng(0)
    places = generator.uniform([1.0, 1.0], [18.0, 12.0], (count, 2))
    size_m = np.array([0.4, 0.4, 0.5])
    blocks = [box(f"stool {k}", np.append(at, 0.0), size_m) for k, at in enumerate(places)]
    blocks += [
        box("cupboard", np.array([1.0, 13.0, 0.0]), np.array([1.0, 0.5, 2.0])),
        box("screen", np.array([5.0, 5.0, 0.0]), np.array([3.0, 0.1, 1.2]), clutter_per_m2=0.0),
        box("wall stool", np.array([0.0, 0.0, 0.0]), np.array([0.4, 0.4, 0.5])),
    ]
    plaster = (material("plaster"),) * 6
    room = shoebox(np.array([20.0, 14.0, 3.0]), plaster, tuple(blocks), seed=9)
    route = np.array([[1.0, 1.0], [19.0, 1.0], [19.0, 13.0], [1.0, 13.0]])
    return World("hall", room, route, people=People((AISLE_M,), 1.2), climate=Climate(24.0, 40.0))


@pytest.fixture(scope="module")
def world() -> World:
    return hall()


def others(room: Room) -> list[object]:
    """All of a room but its blocks."""
    return [getattr(room, item.name) for item in fields(room) if item.name != "blocks"]


def moves(before: Room, after: Room) -> list[tuple[Block, F64, float]]:
    """The blocks that are no longer in their place: how far and by what turn."""
    pairs = zip(before.blocks, after.blocks, strict=True)
    return [
        (b, a.centre_m - b.centre_m, a.turn_rad - b.turn_rad)
        for b, a in pairs
        if (a.centre_m != b.centre_m).any() or a.turn_rad != b.turn_rad
    ]


@pytest.mark.parametrize("day", [1, 7, 14, 30])
def test_more_has_been_moved_on_later_days(world: World, day: int) -> None:
    share = len(moves(world.room, room_on(world, Circumstances(day=day)))) / 300
    expected = min(day * circumstances.MOVED_PER_DAY, 0.5)
    assert share == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / 300))


def test_what_moves_is_low_furniture_and_it_moves_by_little(world: World) -> None:
    room = room_on(world, Circumstances(day=30))
    moved = moves(world.room, room)
    assert all(
        block.top_m <= circumstances.LOW_FURNITURE_M and block.clutter_per_m2 > 0
        for block, _, _ in moved
    )
    shift = np.array([shift for _, shift, _ in moved])
    assert shift.std() == pytest.approx(circumstances.MOVED_M, rel=0.15)
    turns_rad = [turn for _, _, turn in moved]
    assert np.std(turns_rad) == pytest.approx(circumstances.MOVED_RAD, rel=0.15)
    for before, after in zip(world.room.blocks, room.blocks, strict=True):
        same = replace(after, centre_m=before.centre_m, turn_rad=before.turn_rad)
        assert [repr(getattr(same, item.name)) for item in fields(Block)] == [
            repr(getattr(before, item.name)) for item in fields(Block)
        ]
    assert repr(others(world.room)) == repr(others(room))


def test_nothing_is_moved_into_a_wall(world: World) -> None:
    for day in range(30, 60):
        room = room_on(world, Circumstances(day=day))
        assert all(room.holds(block.corners_m).all() for block in room.blocks[:300])


def test_a_day_is_the_same_every_time_and_no_other(world: World) -> None:
    again = [room_on(hall(), Circumstances(day=day)) for day in (20, 20, 21)]
    assert moves(again[0], again[1]) == []
    assert len(moves(again[0], again[2])) > 0


def test_a_state_is_the_worlds() -> None:
    studio = load_world("studio")
    moved = room_on(studio, Circumstances(state="moved"))
    assert moved is studio.states["moved"]
    days = (Circumstances(state="moved", day=day) for day in range(30, 40))
    since = [moves(moved, room_on(studio, day)) for day in days]
    assert 0 < sum(map(len, since)) <= 10 * 4
    shifts_m = [np.linalg.norm(shift) for day in since for _, shift, _ in day]
    assert max(shifts_m) < 5 * circumstances.MOVED_M


def test_an_unknown_state_is_refused_with_the_known_ones(world: World) -> None:
    with pytest.raises(InputError, match="'flooded': world 'studio' has moved; choose one"):
        room_on(load_world("studio"), Circumstances(state="flooded"))
    with pytest.raises(InputError, match="'flooded': world 'hall' has none"):
        room_on(world, Circumstances(state="flooded"))


def test_the_air_is_warmer_or_colder_on_other_days(world: World) -> None:
    speed = np.array([air_on(world, day).speed_mps for day in range(1, 400)])
    per_degree = speed_of_sound_mps(25.0) - speed_of_sound_mps(24.0)
    assert (speed.mean() - speed_of_sound_mps(24.0)) / per_degree == pytest.approx(0, abs=0.3)
    assert speed.std() / per_degree == pytest.approx(circumstances.WARMTH_C, rel=0.15)
    assert air_on(world, 5) == air_on(hall(), 5) != air_on(world, 6)


def celsius(air: Air) -> float:
    return float((air.speed_mps / 343.2) ** 2 * 293.15 - 273.15)


def seeded(seed: int, told_c: float | None) -> World:
    world = hall(0)
    return replace(world, room=replace(world.room, seed=seed), climate=Climate(told_c))


def test_where_nothing_is_told_the_world_is_as_warm_as_the_line_assumes() -> None:
    """Until somebody lives there."""
    assert air_on(seeded(1, None), 0) == air_at(DRAWN_C)
    assert DRAWN_C == 20.0
    assert AcousticOdometryParameters().sound_mps == speed_of_sound_mps(DRAWN_C)


def test_lived_in_rooms_are_never_as_warm_as_the_line_assumes() -> None:
    """From the first day on, as warm as people like it, and a little different every day."""
    first = [celsius(air_on(seeded(seed, None), 0, lived_in=True)) for seed in range(300)]
    assert min(first) == pytest.approx(circumstances.INDOORS_C[0])
    assert max(first) == pytest.approx(circumstances.INDOORS_C[1])
    assert np.mean(first) == pytest.approx(np.mean(circumstances.INDOORS_C), abs=0.5)
    assert min(abs(warmth - DRAWN_C) for warmth in first) >= circumstances.OFF_C - 1e-9
    days = [celsius(air_on(seeded(4, None), day, lived_in=True)) for day in range(60)]
    assert len(set(days)) > 40
    assert np.std(days) < 2 * circumstances.WARMTH_C
    assert air_on(seeded(4, None), 7, lived_in=True) == air_on(seeded(4, None), 7, lived_in=True)


def test_lived_in_rooms_are_about_as_warm_as_they_are_told_to_be() -> None:
    for told_c in (-5.0, DRAWN_C, 24.0):
        days = [celsius(air_on(seeded(1, told_c), day, lived_in=True)) for day in range(300)]
        assert np.mean(days) == pytest.approx(told_c, abs=0.3)
        assert np.std(days) == pytest.approx(circumstances.WARMTH_C, rel=0.15)
        assert min(abs(warmth - DRAWN_C) for warmth in days) >= circumstances.OFF_C - 1e-9


def test_the_volume_scales_all_that_is_played() -> None:
    full, low = (circumstances.device_of(Circumstances(volume=volume)) for volume in (1.0, 0.25))
    assert low.level == pytest.approx(0.25 * full.level)
    for item in fields(Device):
        if item.name != "level":
            assert repr(getattr(low, item.name)) == repr(getattr(full, item.name))


@pytest.mark.parametrize("engine", circumstances.ENGINES)
def test_every_engine_hears_the_room(engine: str) -> None:
    today = Circumstances(engine=engine)
    studio = load_world("studio")
    room = room_on(studio, today)
    poses = poses_at(np.append(studio.route_m[:1], [[1.2]], axis=1), np.zeros(1), np.full(1, 0.4))
    ends = ends_of(built_in_device("flat"), poses)
    extract_echoes = circumstances.engine_of(today, room, 1)
    reach = circumstances.reach_of(today)
    heard = extract_echoes(scene_of(room), ends, poses.people_m, air_at(), reach)
    assert heard.shape == (1, BAND_BINS)
    assert np.abs(heard).max() > 0


T_S = np.arange(0.0, 60.0, 0.1)
FAR_AWAY = np.full((len(T_S), 2), 1e3)


def off_route_m(route_m: F64, xy_m: F64) -> F64:
    """Distance of points (n, 2) from an open route."""
    a, along = route_m[:-1], np.diff(route_m, axis=0)
    share = ((xy_m[:, None] - a) * along).sum(axis=2) / (along**2).sum(axis=1)
    nearest = a + np.clip(share, 0, 1)[:, :, None] * along
    return np.asarray(np.linalg.norm(xy_m[:, None] - nearest, axis=2).min(axis=1))


def test_people_follow_their_route_to_and_fro(world: World) -> None:
    """They never take the way from its end to its start, which leads across the furniture."""
    where = whereabouts(world, 12, 1, T_S, FAR_AWAY)
    assert where.shape == (len(T_S), 12, 2)
    for k in range(12):
        aside = off_route_m(AISLE_M, where[:, k])
        assert aside.max() < 5 * 0.15
        speed = np.linalg.norm(np.diff(where[:, k], axis=0), axis=1) / 0.1
        assert 0.8 * 1.2 * 0.999 <= np.median(speed) <= 1.2 * 1.2 * 1.001
        assert np.ptp(where[:, k], axis=0) == pytest.approx([16.0, 10.0], abs=0.3)
    starts = np.linalg.norm(where[0, :, None] - where[0, None], axis=2)[np.triu_indices(12, 1)]
    assert np.median(starts) > 3.0


def test_where_no_routes_are_told_people_walk_the_phones(world: World) -> None:
    where = whereabouts(replace(world, people=People()), 5, 1, T_S, FAR_AWAY)
    ring = np.vstack([world.route_m, world.route_m[:1]])
    assert max(off_route_m(ring, where[:, k]).max() for k in range(5)) < 5 * 0.15


def test_people_keep_away_from_the_phone(world: World) -> None:
    """All the time, also on its own route; from farther off nobody notices it."""
    phone = np.column_stack([2.0 + 0.2 * T_S, np.full(len(T_S), 2.05)])
    met = whereabouts(world, 20, 3, T_S, phone)
    alone = whereabouts(world, 20, 3, T_S, FAR_AWAY)
    gap = np.linalg.norm(met - phone[:, None], axis=2)
    assert gap.min() >= circumstances.KEEP_AWAY_M - 1e-9
    aside = (met != alone).any(axis=2)
    assert aside.any()
    near = np.linalg.norm(alone - phone[:, None], axis=2) < circumstances.KEEP_AWAY_M
    assert (aside == near).all()
    assert gap[aside] == pytest.approx(circumstances.KEEP_AWAY_M)


def test_people_are_the_recordings(world: World) -> None:
    where = whereabouts(world, 4, 7, T_S, FAR_AWAY)
    assert (whereabouts(hall(), 4, 7, T_S, FAR_AWAY) == where).all()
    assert (whereabouts(world, 4, 8, T_S, FAR_AWAY) != where).any()
    assert (whereabouts(world, 9, 7, T_S, FAR_AWAY)[:, :4] == where).all()


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"day": -1}, "day: wanted 0 to 36500, got -1"),
        ({"people": 51}, "people: wanted 0 to 50, got 51"),
        ({"other_phones": 9}, "other phones: wanted 0 to 8, got 9"),
        ({"softer_db": 21.0}, "softer chirps: wanted 0.0 to 20.0, got 21.0"),
        ({"volume": 0.0}, "volume: wanted 0.001 to 1.0, got 0.0"),
        ({"volume": 1.5}, "volume: wanted 0.001 to 1.0, got 1.5"),
        ({"volume": float("nan")}, "volume: wanted 0.001 to 1.0, got nan"),
        ({"sounds": ("speech", "thunder")}, "'thunder': wanted speech, music, clicks"),
        ({"engine": "rays"}, "'rays': wanted images or diffuse or pyroomacoustics"),
    ],
)
def test_impossible_circumstances_are_refused(wrong: dict[str, object], complaint: str) -> None:
    with pytest.raises(ParameterError, match=complaint) as refusal:
        Circumstances(**wrong)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("text", ["", "speech", "speech,clicks", " speech , clicks,", "thunder"])
def test_sounds_are_parsed(text: str) -> None:
    wanted = text.replace(" ", "").strip(",").split(",") * bool(text)
    assert list(circumstances.parse_sounds(text)) == wanted
    assert set(circumstances.SOUNDS) == {"speech", "music", "clicks"}

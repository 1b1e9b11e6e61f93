"""Training material: two echoes per place, closer than 20 cm, cut as the line cuts them."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F32
from elfslam.base.errors import ParameterError
from elfslam.base.values import DISCARDED_SAMPLES, ECHO_SAMPLES, Audio, EchoPairs
from elfslam.stages.chirp import ChirpParameters, make_chirp
from elfslam.stages.echo import EchoParameters, cut_echoes
from elfslam.stages.feature import load_encoder
from elfslam.world import echo_pairs as module
from elfslam.world.device import named_device
from elfslam.world.materials import Material
from elfslam.world.phone import poses_at, render_frames, room_responses
from elfslam.world.room import Block, Room, box, check_outline
from elfslam.world.scene import scene_of


def generator_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def pairs() -> EchoPairs:
    return module.echo_pairs(generator_of(7), 240, 6)


def test_every_place_has_two_echoes_and_every_room_as_many(pairs: EchoPairs) -> None:
    assert pairs.first.shape == pairs.second.shape == (240, ECHO_SAMPLES)
    assert pairs.room.tolist() == np.repeat(np.arange(6), 40).tolist()
    assert pairs.first.dtype == np.float32
    assert pairs.first.flags.c_contiguous
    assert (pairs.xy_m > 0).all()
    assert (np.linalg.norm(pairs.first, axis=1) > 0).all()


def test_the_two_echoes_of_a_place_differ(pairs: EchoPairs) -> None:
    assert not (pairs.first == pairs.second).all(axis=1).any()
    assert len(np.unique(pairs.first, axis=0)) == 240


def test_a_generator_gives_one_batch() -> None:
    one, again, other = (module.echo_pairs(generator_of(seed), 12, 2) for seed in (7, 7, 8))
    for name in ("first", "second", "room", "xy_m"):
        assert getattr(again, name).tobytes() == getattr(one, name).tobytes()
    assert not (other.first == one.first).any(axis=1).any()


def test_positives_fill_the_disc_evenly() -> None:
    shift = module._within(generator_of(0), 20_000, module.POSITIVE_DISTANCE_M)
    assert module.POSITIVE_DISTANCE_M == 0.20
    share = (np.linalg.norm(shift, axis=1) / module.POSITIVE_DISTANCE_M) ** 2  # uniform in [0, 1]
    assert share.mean() == pytest.approx(0.5, abs=0.01)
    assert share.max() < 1.0
    assert np.abs(shift.mean(axis=0)).max() < 0.003


def test_at_one_time_nothing_changes_between_the_two_echoes() -> None:
    first, second = module.at_one_time(generator_of(1), "images")
    assert first is second
    assert (first.people, first.device.name) == (0, "simulated phone")


def test_pairs_that_do_not_share_out_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"multiple of rooms \(3\), got 10; change one"):
        module.echo_pairs(generator_of(0), 10, 3)


def square_room(*blocks: Block) -> Room:
    """An empty room of 8 by 6 m with these blocks."""
    bare = module.random_room(generator_of(2))
    outline = np.array([[0, 0], [8, 0], [8, 6], [0, 6]], dtype=np.float64)
    return Room(outline, 2.5, bare.walls[:4], bare.floor, bare.ceiling, blocks, 1)


@pytest.mark.parametrize("count", [8, 9])
def test_half_of_the_places_are_the_others_after_half_a_turn(count: int) -> None:
    xy, yaw = module._places(generator_of(3), square_room(), count, twins=True)
    half = (count + 1) // 2
    assert xy.shape == (count, 2)
    assert yaw.shape == (count,)
    np.testing.assert_allclose(xy[half:], [8.0, 6.0] - xy[: count - half])
    np.testing.assert_allclose(yaw[half:], yaw[: count - half] + np.pi)
    assert (xy >= module.WALL_MARGIN_M).all()
    assert (xy <= [8.0 - module.WALL_MARGIN_M, 6.0 - module.WALL_MARGIN_M]).all()


def test_only_what_is_blocked_after_half_a_turn_is_placed_anew() -> None:
    """A cupboard fills the left half: nothing to the right of it can be turned onto it."""
    cupboard = box("cupboard", np.array([0.0, 0.0, 0.0]), np.array([3.0, 6.0, 2.0]))
    room = square_room(cupboard)
    xy, _ = module._places(generator_of(4), room, 400, twins=True)
    turned, blocked = [8.0, 6.0] - xy[:200], 8.0 - xy[:200, 0] < 3.0 + module.WALL_MARGIN_M
    assert 0.2 < blocked.mean() < 0.9
    np.testing.assert_allclose(xy[200:][~blocked], turned[~blocked])
    assert room.is_free(xy, module.PHONE_HEIGHT_M, module.WALL_MARGIN_M).all()
    assert (xy[200:][blocked] != turned[blocked]).any(axis=1).all()


@pytest.mark.parametrize("seed", range(8))
def test_places_are_free(seed: int) -> None:
    """In the room and in no furniture; the margin gives way only where there is no room for it."""
    room = module.random_room(generator_of(seed))
    xy, _ = module._places(generator_of(seed + 1), room, 40, twins=True)
    assert room.is_free(xy, module.PHONE_HEIGHT_M).all()
    assert room.is_free(xy, module.PHONE_HEIGHT_M, 0.2).mean() > 0.9


@pytest.mark.parametrize("seed", range(2))
def test_phones_of_one_holder_are_alike(seed: int) -> None:
    generator = generator_of(seed)
    height_m, pitch_rad, body_m = holder = module._random_holder(generator)
    assert 1.05 <= height_m <= 1.40
    xy, yaw = generator.uniform(1.0, 5.0, (500, 2)), generator.uniform(-3.0, 3.0, 500)
    poses = module._random_poses(generator, xy, yaw, holder)
    assert (poses.position_m[:, :2] == xy).all()
    assert poses.position_m[:, 2].mean() == pytest.approx(height_m, abs=0.01)
    assert (poses.body_distance_m == body_m).all()
    assert poses.people_m.shape == (500, 0, 2)
    ahead = poses.world_from_phone[:, :, 1]
    assert np.arcsin(ahead[:, 2]).mean() == pytest.approx(pitch_rad, abs=0.02)
    angle = np.angle(np.exp(1j * (np.arctan2(ahead[:, 1], ahead[:, 0]) - yaw)))
    assert angle.std() == pytest.approx(0.12, rel=0.15)
    speed = np.linalg.norm(poses.velocity_mps, axis=1)
    assert (poses.velocity_mps[:, 2] == 0).all()
    assert 1.3 < speed.max() <= 1.5
    np.testing.assert_allclose(
        poses.velocity_mps[:, :2] * np.linalg.norm(ahead[:, :2], axis=1, keepdims=True),
        speed[:, None] * ahead[:, :2], atol=1e-9,
    )  # fmt: skip


def test_the_second_echo_is_heard_close_by(monkeypatch: pytest.MonkeyPatch) -> None:
    heard = []

    def listen(scene, device, poses, air, engine):
        heard.append(poses)
        return room_responses(scene, device, poses, air, engine=engine)

    monkeypatch.setattr(module, "room_responses", listen)
    made = module.echo_pairs(generator_of(5), 40, 4)
    gaps = [
        np.linalg.norm(first.position_m[:, :2] - second.position_m[:, :2], axis=1)
        for first, second in zip(heard[::2], heard[1::2], strict=True)
    ]
    assert np.concatenate(gaps).max() <= module.POSITIVE_DISTANCE_M
    assert np.concatenate(gaps).mean() == pytest.approx(module.POSITIVE_DISTANCE_M * 2 / 3, rel=0.2)
    places = np.concatenate([poses.position_m[:, :2] for poses in heard[::2]])
    assert (places == made.xy_m).all()


@pytest.mark.parametrize("name", ["spectral", "compact"])
def test_an_encoder_tells_near_from_far(pairs: EchoPairs, name: str) -> None:
    """Within a room, pairs score above places one metre and more apart."""
    encoder = load_encoder(name)
    first, second = encoder.embed(pairs.first), encoder.embed(pairs.second)
    cosine = first @ second.T
    distance_m = np.linalg.norm(pairs.xy_m[:, None] - pairs.xy_m[None], axis=2)
    far = (pairs.room[:, None] == pairs.room[None]) & (distance_m > 1.0)
    assert np.diag(cosine).mean() > cosine[far].mean() + 0.1


def test_traces_are_cut_where_the_line_cuts_them() -> None:
    """Up to the jitter of two samples that stands for the search for the direct sound."""
    generator, device = generator_of(1), named_device("named")
    room, chirp = module.random_room(generator), make_chirp(ChirpParameters(), 44_100)
    place_m = np.append(room.size_m[:2] / 2, 1.2)
    still = poses_at(place_m[None], np.zeros(1), np.zeros(1))
    response = room_responses(scene_of(room), device, still)
    frame = render_frames(response, chirp, device)
    stream = Audio(np.tile(frame, (1, 30)), 44_100)
    by_line = cut_echoes(stream, chirp, EchoParameters()).samples[0]
    for ours in module.cut_frames(generator, np.repeat(frame, 8, axis=0), device):
        lags = np.correlate(ours, by_line, mode="same")
        assert abs(int(lags.argmax()) - ECHO_SAMPLES // 2) <= 3
    assert DISCARDED_SAMPLES == 485


def test_places_lie_in_one_district() -> None:
    bare = module.random_room(generator_of(2))
    outline = np.array([[0, 0], [40, 0], [40, 30], [0, 30]], dtype=np.float64)
    hall = Room(outline, 5.0, bare.walls[:4], bare.floor, bare.ceiling, (), 1)
    corners = []
    for seed in range(10):
        xy, yaw = module._places(generator_of(seed), hall, 64, twins=False)
        assert xy.shape == (64, 2)
        assert yaw.shape == (64,)
        assert np.ptp(xy, axis=0).max() <= module.DISTRICT_M
        corners.append(xy.min(axis=0))
    assert np.ptp(corners, axis=0).min() > 5.0


VISITS = 400


@pytest.fixture(scope="module")
def visits() -> list[tuple[module.Visit, module.Visit]]:
    made = []
    for seed in range(VISITS):
        first = module._random_visit(generator_of(seed), square_room(), "images")
        made.append((first, module._another_visit(generator_of(seed + VISITS), first)))
    return made


def test_what_changes_between_two_visits(visits: list[tuple[module.Visit, module.Visit]]) -> None:
    for field, share in (
        ("room", module.CHANGED_ROOM_SHARE),
        ("device", module.OTHER_PHONE_SHARE),
        ("holder", module.STRANGER_SHARE),
        ("air", 1.0),
    ):
        other = [getattr(a, field) is not getattr(b, field) for a, b in visits]
        assert np.mean(other) == pytest.approx(share, abs=0.08), field
    people = np.array([[a.people, b.people] for a, b in visits])
    assert (people > 0).mean() == pytest.approx(module.PEOPLE_SHARE, abs=0.06)
    assert people.max() == module.MOST_PEOPLE
    assert abs(np.corrcoef(people.T)[0, 1]) < 0.15, "people come and go"


def test_a_visit_is_heard_by_its_phone_in_its_room() -> None:
    """Level and noise are those of the phone; the echo of another room is another."""
    visit = module._random_visit(generator_of(4), square_room(), "images")._replace(people=0)
    xy, yaw = np.tile([2.0, 3.0], (4, 1)), np.zeros(4)
    chirp = make_chirp(ChirpParameters(), 44_100)

    def heard_at(each: module.Visit) -> F32:
        there = module._sounding(each.room, each.engine)
        return module._heard(generator_of(0), each, there, xy, yaw, chirp)

    quiet = visit._replace(device=replace(visit.device, level=0.0, noise_rms=0.01))
    noise = heard_at(quiet)
    assert noise.shape == (4, ECHO_SAMPLES)
    assert noise.std() == pytest.approx(0.01, rel=0.05)
    carpeted = visit._replace(room=module.changed_room(generator_of(3), visit.room))
    here, there = heard_at(visit), heard_at(carpeted)
    assert np.abs(here - there).max() > 0.05 * np.abs(here).max()


def test_the_engine_changes_the_sound_and_neither_rooms_nor_places() -> None:
    engines = ("images", "diffuse")
    plain, diffuse = (module.echo_pairs(np.random.default_rng(3), 4, 2, by) for by in engines)
    assert (plain.xy_m == diffuse.xy_m).all()
    assert (plain.room == diffuse.room).all()
    assert not np.allclose(plain.first, diffuse.first)


ROOMS = 300


def room_of(seed: int) -> Room:
    return module.random_room(np.random.default_rng(seed))


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
        assert 2.3 <= height <= (3.6 if length * width < 0.7 * module.HIGH_FROM_M2 else 6.0)
    areas = np.array([area_m2(room.outline_m) for room in rooms])
    assert np.median(areas) == pytest.approx(100.0, rel=0.4), "even on a logarithmic scale"


def test_some_lack_a_corner_and_some_lean(rooms: list[Room]) -> None:
    lacking = np.mean([len(room.outline_m) == 6 for room in rooms])
    leaning = np.mean([not is_square(room) for room in rooms])
    assert lacking == pytest.approx(module.CORNER_SHARE, abs=0.08)
    assert leaning == pytest.approx(module.LEANING_SHARE, abs=0.08)
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
    assert 0.8 * module.MOST_FURNITURE < max(furniture) <= module.MOST_FURNITURE
    assert np.median(furniture) > 5
    assert (min(partitions), max(partitions)) == (0, module.MOST_PARTITIONS)
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
    return [module.changed_room(np.random.default_rng(k), room) for k, room in enumerate(rooms)]


def test_a_changed_room_keeps_shape_and_partitions(rooms: list[Room], changed: list[Room]) -> None:
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
    assert np.mean(new) == pytest.approx(module.NEW_SURFACE_SHARE, abs=0.04)


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
    assert np.mean(gone) == pytest.approx(module.GONE_SHARE, abs=0.04)
    assert 0.5 * module.MOVED_SHARE < np.mean(moved) < module.MOVED_SHARE, (
        "some would leave the room and stay"
    )

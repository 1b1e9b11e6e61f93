"""Echo synthesis: planted paths at their delay and level, what hides them, and laws."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_phone import (
    AIR,
    C128,
    DEAD,
    HARD,
    SIZE_M,
    UP,
    X,
    assert_one_path,
    dead_room,
    ends_at,
    heard,
)

from elfslam.base.arrays import F64
from elfslam.world.acoustics import PERSON_REFLECTION
from elfslam.world.device import BAND_BINS
from elfslam.world.materials import Material
from elfslam.world.paths import Reach
from elfslam.world.phone import Transducers
from elfslam.world.plan import PERSON_RADIUS_M
from elfslam.world.pulses import BASEBAND_HZ, CARRIER_HZ, PHASES, TAPS, pulse_table
from elfslam.world.room import Room, box, shoebox
from elfslam.world.scene import EDGE_GAIN, Scene, scene_of

WALLS = tuple(
    Material(f"wall {k}", 1 - gain**2, 0.0, "planted")
    for k, gain in enumerate((0.7, 0.6, 0.65, 0.75, 0.5, 0.8))
)
DEEP = Reach(order=4, plan_order=4, block_order=4, beside_block=4)


def naive_envelope(ends: Transducers, reach: Reach) -> C128:
    """Allen and Berkley's sum over images (1979), each pulse laid down by plain arithmetic."""
    out, table = np.zeros(BAND_BINS + 2 * TAPS, dtype=np.complex128), pulse_table()
    (speaker,), (microphone,), (s_axis,), (m_axis,) = ends[:4]
    near, far = np.array([wall.reflection for wall in WALLS]).reshape(3, 2).T
    for n in product(range(-reach.order, reach.order + 1), repeat=3):
        for odd in product(range(2), repeat=3):
            away, flip = np.array(n), np.array(odd)
            if (np.abs(away - flip) + np.abs(away)).sum() > reach.order:
                continue
            sign = 1 - 2 * flip
            way = sign * speaker + 2 * away * SIZE_M - microphone
            length = np.linalg.norm(way)
            if length > reach.longest_m:
                continue
            gain = np.prod(near ** np.abs(away - flip) * far ** np.abs(away)) / length
            gain *= np.exp(-AIR.attenuation_per_m * length)
            b = ends.speaker_directivity
            gain *= 1 - b + b * (s_axis @ (-sign * way)) / length
            gain *= 1 - b + b * (m_axis @ way) / length
            delay = length / AIR.speed_mps
            whole, part = divmod(delay * BASEBAND_HZ, 1.0)
            pulse = table[int(part * PHASES + 0.5)] * np.exp(-2j * np.pi * CARRIER_HZ * delay)
            first = int(whole) + 1 - TAPS // 2 + TAPS
            out[first : first + TAPS] += gain * pulse
    return out[TAPS:-TAPS]


@pytest.mark.parametrize("directivity", [0.0, 0.4])
def test_a_shoebox_is_a_plain_sum_over_its_images(directivity: float) -> None:
    axis = np.array([2.0, -1.0, 0.5]) / np.linalg.norm([2.0, -1.0, 0.5])
    ends = ends_at(axis=axis, directivity=directivity)
    ours, naive = heard(shoebox(SIZE_M, WALLS), ends, reach=DEEP), naive_envelope(ends, DEEP)
    assert np.linalg.norm(naive) > 0.1
    assert np.linalg.norm(ours - naive) < 1e-5 * np.linalg.norm(naive)


def test_nothing_is_heard_beyond_the_longest_path() -> None:
    """The far wall is 10 m away: there and back a little over 20 m."""
    hall = shoebox(np.array([11.0, 5.0, 3.0]), (DEAD, HARD, *(DEAD,) * 4))
    ends = ends_at(np.array([1.0, 2.5, 1.5]), np.array([1.0, 2.6, 1.5]), held=True)
    assert np.abs(heard(hall, ends, reach=Reach(longest_m=20.1))).max() > 0
    assert not heard(hall, ends, reach=Reach(longest_m=19.9)).any()


def test_what_stands_between_hides_and_what_is_lower_does_not() -> None:
    low_m, high_m = np.array([1.0, 2.5, 1.4]), np.array([6.0, 2.5, 1.4])
    ends = ends_at(low_m, high_m)
    for base_m, top_m, hidden in (
        (0.0, 3.0, True), (0.0, 1.5, True), (0.0, 1.3, False), (1.3, 1.5, True), (1.5, 2.0, False),
    ):  # fmt: skip
        size_m = [0.2, 3.0, top_m - base_m]
        block = box("partition", [3.0, 1.0, base_m], size_m, DEAD, clutter_per_m2=0.0)
        scene = scene_of(dead_room(block))._replace(edge_a=np.zeros((0, 3)))
        assert np.abs(heard(scene, ends)).max() == pytest.approx(0.0) or not hidden
        if not hidden:
            assert_one_path(heard(scene, ends), 5.0, 1.0)


@pytest.mark.parametrize(("top_m", "gain"), [(1.5, HARD.reflection), (1.1, 0.0)])
def test_a_block_reflects_as_high_as_it_is(top_m: float, gain: float) -> None:
    """Side at x = 3, sound at 1.2 m above the floor."""
    shelf = box("shelf", [3.0, 1.0, 0.0], [0.5, 3.0, top_m], HARD, clutter_per_m2=0.0)
    scene = scene_of(dead_room(shelf))._replace(edge_a=np.zeros((0, 3)))
    speaker_m, microphone_m = np.array([1.0, 2.0, 1.2]), np.array([1.5, 3.0, 1.2])
    ends = ends_at(speaker_m, microphone_m, held=True)
    response = heard(scene, ends)
    if gain:
        assert_one_path(response, np.hypot(3.5, 1.0), gain)
    else:
        assert not response.any()


def test_a_table_top_is_a_mirror_too() -> None:
    table = box("table", [1.0, 1.0, 0.0], [4.0, 3.0, 0.7], HARD, clutter_per_m2=0.0)
    scene = scene_of(dead_room(table))._replace(edge_a=np.zeros((0, 3)))
    speaker_m, microphone_m = np.array([2.0, 2.0, 1.2]), np.array([3.0, 2.5, 1.5])
    response = heard(scene, ends_at(speaker_m, microphone_m, held=True))
    image_m = speaker_m * [1, 1, -1] + [0, 0, 1.4]
    assert_one_path(response, np.linalg.norm(image_m - microphone_m), HARD.reflection)


def test_a_table_hides_the_floor_below_it() -> None:
    floor = shoebox(SIZE_M, (*(DEAD,) * 4, HARD, DEAD))
    table = box("table", [1.0, 1.0, 0.0], [4.0, 3.0, 0.7], DEAD, clutter_per_m2=0.0)
    ends = ends_at([2.0, 2.0, 1.2], [3.0, 2.5, 1.5], held=True)
    bare = scene_of(floor)
    covered = scene_of(replace(floor, blocks=(table,)))._replace(edge_a=np.zeros((0, 3)))
    assert np.abs(heard(bare, ends)).max() > 0.1
    assert not heard(covered, ends).any()


def scatterer(point_m: F64, radius_m: float, normal: F64 = -X) -> Scene:
    return scene_of(dead_room())._replace(
        point=np.array([point_m]), point_normal=normal[None], point_radius=np.array([radius_m])
    )


def test_a_scatterer_is_heard_after_there_and_back() -> None:
    point_m = np.array([5.0, 2.5, 1.3])
    speaker_m, microphone_m = np.array([2.0, 2.2, 1.2]), np.array([2.3, 2.8, 1.5])
    there, home = np.linalg.norm(point_m - speaker_m), np.linalg.norm(point_m - microphone_m)
    response = heard(scatterer(point_m, 0.1), ends_at(speaker_m, microphone_m, held=True))
    assert_one_path(response, there + home, 0.05 / (there * home) * (there + home))


def test_a_scatterer_on_a_face_that_looks_away_is_not_heard() -> None:
    scene = scatterer(np.array([5.0, 2.5, 1.3]), 0.1, normal=X)
    assert not heard(scene, ends_at(held=True)).any()


def test_an_upright_edge_diffracts() -> None:
    """From the diagonal before a corner all other edges are hidden or end elsewhere."""
    away_m = 1.0
    crate = box("crate", [3.0, 2.0, 0.0], [1.0, 1.0, 2.0], DEAD, clutter_per_m2=0.0)
    place_m = np.array([3.0 - away_m / np.sqrt(2), 2.0 - away_m / np.sqrt(2), 1.0])
    response = heard(dead_room(crate), ends_at(place_m, place_m + 1e-6 * UP, held=True))
    strength = EDGE_GAIN * np.sqrt(away_m / 2) / away_m**2
    assert_one_path(response, 2 * (away_m - 0.005), strength * 2 * away_m, rel=0.02)


def test_a_person_reflects_like_a_cylinder() -> None:
    place_m, person_m = np.array([2.0, 2.5, 1.2]), np.array([4.0, 2.5])
    ends = ends_at(place_m, place_m + 1e-6 * UP, held=True)
    response = heard(dead_room(), ends, person_m)
    gap_m = 2.0 - PERSON_RADIUS_M
    curved = 1 / np.sqrt(1 + gap_m / PERSON_RADIUS_M)
    assert_one_path(response, 2 * gap_m - 0.01, PERSON_REFLECTION * curved, rel=0.02)


def furnished(turn_rad: float = 0.0) -> Room:
    """An L-shaped room with a table, a shelf and a pillar; only the blocks carry clutter."""
    outline = np.array([[0, 0], [6, 0], [6, 3], [3.5, 3], [3.5, 5], [0, 5]], dtype=float)
    blocks = (
        box("table", [1.0, 1.0, 0.0], [1.5, 0.8, 0.7], HARD),
        box("shelf", [4.5, 2.4, 0.0], [1.0, 0.4, 1.8], HARD, turn_rad=0.2),
        box("pillar", [1.5, 3.5, 0.0], [0.4, 0.4, 2.5], HARD, 0.5, 0.0),
    )
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    turn = np.array([[cos, sin], [-sin, cos]])
    moved = tuple(
        replace(block, centre_m=block.centre_m @ turn + 20, turn_rad=block.turn_rad + turn_rad)
        for block in blocks
    )
    return Room(outline @ turn + 20, 2.5, WALLS, WALLS[0], WALLS[1], moved)


def turned(points: F64, turn_rad: float) -> F64:
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)
    return np.asarray(points @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1.0]]))


ORIGIN_M = np.array([20.0, 20.0, 0.0])
PLAIN_SCENE = scene_of(furnished())


def drawn(seed: int) -> tuple[F64, F64, F64, F64]:
    """Two places of `furnished` above the shelf, and two directions; none on any line of it."""
    generator = np.random.default_rng(seed)
    places = generator.uniform([0.1, 0.1, 1.85], [3.4, 4.9, 2.4], (2, 3))
    axes = generator.standard_normal((2, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return places[0], places[1], axes[0], axes[1]


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32))
def test_speaker_and_microphone_may_change_places(seed: int) -> None:
    one, other, speaks, hears = drawn(seed)
    rows = [row[None] for row in (one + ORIGIN_M, other + ORIGIN_M, speaks, hears)]
    rest = (np.array([[1.0, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3)), 0.35, 0.35, False)
    there = heard(PLAIN_SCENE, Transducers(*rows, *rest), reach=DEEP)
    back = heard(PLAIN_SCENE, Transducers(rows[1], rows[0], rows[3], rows[2], *rest), reach=DEEP)
    assert np.linalg.norm(there - back) <= 1e-6 * np.linalg.norm(there)


@settings(max_examples=40)
@given(seed=st.integers(0, 2**32), turn_rad=st.floats(0.01, 6.27))
def test_a_turned_world_sounds_the_same(seed: int, turn_rad: float) -> None:
    one, other, axis, _ = drawn(seed)
    here = ends_at(one + ORIGIN_M, other + ORIGIN_M, axis=axis, directivity=0.3)
    one, other = (turned(place, turn_rad) + ORIGIN_M for place in (one, other))
    there = ends_at(one, other, axis=turned(axis, turn_rad), directivity=0.3)
    before = heard(PLAIN_SCENE, here, reach=DEEP)
    after = heard(furnished(turn_rad), there, reach=DEEP)
    assert np.linalg.norm(before - after) <= 1e-5 * np.linalg.norm(before)

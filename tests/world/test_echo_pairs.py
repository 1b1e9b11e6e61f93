"""Training material: two echoes per place, closer than 20 cm, cut as the line cuts them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base.values import DISCARDED_SAMPLES, ECHO_SAMPLES, Audio, EchoPairs
from elfslam.line.chirp import ChirpParameters, make_chirp
from elfslam.line.echo import EchoParameters, cut_echoes
from elfslam.line.feature import load_encoder
from elfslam.world.acoustics import image_sources, render_frames, room_responses
from elfslam.world.device import named_device
from elfslam.world.echo_pairs import (
    POSITIVE_DISTANCE_M,
    WALL_MARGIN_M,
    _cut,
    _places,
    _within,
    echo_pairs,
    random_device,
    random_room,
)


def generator_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def pairs() -> EchoPairs:
    return echo_pairs(generator_of(7), 240, 6)


def test_every_place_has_two_echoes_and_every_room_as_many(pairs: EchoPairs) -> None:
    assert pairs.first.shape == pairs.second.shape == (240, ECHO_SAMPLES)
    assert np.bincount(pairs.room).tolist() == [40] * 6
    assert (pairs.xy_m >= WALL_MARGIN_M).all()
    assert (np.linalg.norm(pairs.first, axis=1) > 0).all()


def test_the_two_echoes_of_a_place_differ(pairs: EchoPairs) -> None:
    assert not (pairs.first == pairs.second).all(axis=1).any()
    assert len(np.unique(pairs.first, axis=0)) == 240


def test_a_generator_gives_one_batch(pairs: EchoPairs) -> None:
    again, other = echo_pairs(generator_of(7), 240, 6), echo_pairs(generator_of(8), 240, 6)
    for name in ("first", "second", "room", "xy_m"):
        assert getattr(again, name).tobytes() == getattr(pairs, name).tobytes()
    assert not (other.first == pairs.first).any(axis=1).any()


@given(seed=st.integers(0, 2**32 - 1), radius_m=st.floats(0.01, 2.0))
def test_positives_are_close_by_construction(seed: int, radius_m: float) -> None:
    shift = _within(generator_of(seed), 100, radius_m)
    assert shift.shape == (100, 2)
    assert np.linalg.norm(shift, axis=1).max() < radius_m


def test_positives_fill_the_disc_evenly() -> None:
    shift = _within(generator_of(0), 20_000, POSITIVE_DISTANCE_M)
    assert POSITIVE_DISTANCE_M == 0.20
    share = (np.linalg.norm(shift, axis=1) / POSITIVE_DISTANCE_M) ** 2  # uniform in [0, 1]
    assert share.mean() == pytest.approx(0.5, abs=0.01)
    assert np.abs(shift.mean(axis=0)).max() < 0.003


@pytest.mark.parametrize("count", [8, 9])
def test_half_of_the_places_are_the_others_after_half_a_turn(count: int) -> None:
    room = random_room(generator_of(2))
    xy, yaw = _places(generator_of(3), room, count)
    half = (count + 1) // 2
    assert xy.shape == (count, 2)
    assert yaw.shape == (count,)
    np.testing.assert_allclose(xy[half:], room.size_m[:2] - xy[: count - half])
    np.testing.assert_allclose(yaw[half:], yaw[: count - half] + np.pi)
    assert (xy >= WALL_MARGIN_M).all()
    assert (xy <= room.size_m[:2] - WALL_MARGIN_M).all()


@pytest.mark.parametrize("name", ["spectral", "compact"])
def test_an_encoder_tells_near_from_far(pairs: EchoPairs, name: str) -> None:
    """Within a room, pairs score above places one metre and more apart."""
    encoder = load_encoder(name)
    first, second = encoder.embed(pairs.first), encoder.embed(pairs.second)
    cosine = first @ second.T
    distance_m = np.linalg.norm(pairs.xy_m[:, None] - pairs.xy_m[None], axis=2)
    far = (pairs.room[:, None] == pairs.room[None]) & (distance_m > 1.0)
    assert np.diag(cosine).mean() > cosine[far].mean() + 0.1


@pytest.mark.parametrize("seed", range(20))
def test_random_rooms_are_rooms(seed: int) -> None:
    room = random_room(generator_of(seed))
    assert 9.0 <= room.size_m[:2].prod() <= 400.0
    assert 2.3 <= room.size_m[2] <= 3.6
    assert (room.reflection >= 0.3).all()
    assert (room.reflection <= 0.97).all()
    assert 2 <= len(room.furniture) <= 24
    assert (room.scatterers_m >= 0).all()
    assert (room.scatterers_m <= room.size_m + 1e-9).all()


def test_random_phones_differ_by_the_ripple_of_real_ones() -> None:
    ripple_db = [
        np.ptp(20 * np.log10(random_device(generator_of(seed)).response)) for seed in range(40)
    ]
    assert min(ripple_db) > 2.0 - 1e-6
    assert max(ripple_db) < 25.0 + 1e-6
    assert np.std(ripple_db) > 3.0


def test_traces_are_cut_where_the_line_cuts_them() -> None:
    """Up to the jitter of two samples that stands for the search for the direct sound."""
    generator, device = generator_of(1), named_device("named")
    room, chirp = random_room(generator), make_chirp(ChirpParameters(), 44_100)
    place_m = np.append(room.size_m[:2] / 2, 1.2)
    response = room_responses(
        room, image_sources(room), device, place_m[None], np.zeros(1), np.zeros(1), np.full(1, 0.35)
    )
    frame = render_frames(response, chirp, device)
    stream = Audio(np.tile(frame, (1, 30)), 44_100)
    by_line = cut_echoes(stream, chirp, EchoParameters()).samples[0]
    for ours in _cut(generator, np.repeat(frame, 8, axis=0), device):
        lags = np.correlate(ours, by_line, mode="same")
        assert abs(int(lags.argmax()) - ECHO_SAMPLES // 2) <= 3
    assert DISCARDED_SAMPLES == 485

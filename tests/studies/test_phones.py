"""Real phones beside simulated ones, in small."""

from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from elfslam.world.circumstances import Circumstances, engine_of
from elfslam.world.device import MEASURED as MODELLED
from elfslam.world.device import built_in_device
from elfslam.world.phone import Engine, poses_at, room_responses
from elfslam.world.recorder import phone_poses
from elfslam.world.scattering import as_measured
from elfslam.world.scene import Scene, scene_of
from elfslam.world.simulate import load_world
from elfslam.world.stroll import random_person
from elfslam.world.walker import Straying, motion_along, smooth_lap
from studies.phones import (
    MEASURED,
    SIMULATED,
    Heard,
    as_swept,
    compressed_noise_rms,
    level_db,
    measure_phones,
)
from studies.realism import RATE_HZ, banded, kurtosis, response_of, spread_db
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def records(shared_data: Path) -> list[Record]:
    context = StudyContext(data=shared_data)
    return measure_phones(
        context, worlds=("studio",), devices=("ordinary phone",), rooms=("studio",),
        modelled=("galaxy s4 mic 1", "iphone 5c up in hand"), places=12,
    )  # fmt: skip


@pytest.fixture(scope="module")
def studio() -> tuple[Scene, Engine]:
    room = as_measured(load_world("studio").room)
    return scene_of(room), engine_of(Circumstances(engine="diffuse"), room, 1)


def heard_along(studio: tuple[Scene, Engine], device: str) -> Heard:
    """A measured phone at places along the route."""
    route_m = load_world("studio").route_m
    xy_m = np.concatenate([a + 0.5 * (b - a) for a, b in pairwise([*route_m, *route_m[:1]])])
    places = np.column_stack([xy_m.reshape(-1, 2), np.full(len(route_m), 1.2)])
    poses = poses_at(places, np.arange(len(places)) * 1.1, np.full(len(places), 0.4))
    phone = built_in_device(device)
    response = response_of(room_responses(studio[0], phone, poses, engine=studio[1]))
    return as_swept(device, response, compressed_noise_rms(device))


@pytest.mark.parametrize("device", MODELLED)
def test_a_modelled_phone_hears_itself_and_the_room_as_the_measured_one(
    studio: tuple[Scene, Engine], device: str
) -> None:
    """Each column within its band; where only noise was heard, the noise says the levels."""
    known, phone = MODELLED[device], heard_along(studio, device)
    band = banded(phone.responses, RATE_HZ)
    direct = np.abs(band[:, : RATE_HZ // 1000]).max(axis=1)
    assert all(2.4 < each < 3.2 for each in kurtosis(band, RATE_HZ))
    assert all(4.6 < each < 6.2 for each in spread_db(band, RATE_HZ))
    noise_db = float(np.median(20 * np.log10(phone.noise_rms / direct)))
    if known.noise_db > 0:
        assert noise_db > 10.0
        return
    assert noise_db == pytest.approx(known.noise_db, abs=2.0)
    assert level_db(band, direct)[0] == pytest.approx(known.echo_db, abs=3.0)


def test_a_hand_that_stands_still_keeps_an_echo_as_measured(studio: tuple[Scene, Engine]) -> None:
    """Envelopes of real phones in hands: 0.5 to 0.99 from chirp to chirp, -0.03 to 0.86 (median
    0.4) five seconds apart (LibAcousticSensing; from 5 ms on)."""
    soon, late = np.median([likeness_standing(studio, seed) for seed in range(4)], axis=0)
    assert 0.8 < soon < 0.99
    assert 0.2 < late < 0.6


def likeness_standing(studio: tuple[Scene, Engine], seed: int) -> tuple[float, float]:
    """Correlation of envelopes 0.1 s and 5 s apart of somebody who stands for 8 s."""
    world, generator = load_world("studio"), np.random.default_rng([seed, 77])
    person, still = random_person(generator, 0.3), np.zeros(3200)
    straying = Straying(*(still for _ in fields(Straying)))
    motion = motion_along(person, *smooth_lap(world.route_m), still, straying, generator)
    poses = phone_poses(person, motion, world, 0, seed, np.arange(0.0, 7.9, 0.1))
    phone = built_in_device("galaxy s4 mic 1")
    band = banded(response_of(room_responses(studio[0], phone, poses, engine=studio[1])), RATE_HZ)
    envelope = np.abs(signal.hilbert(band, axis=1))[:, RATE_HZ // 200 : RATE_HZ // 40]
    alike = np.corrcoef(envelope)
    return float(np.median(np.diag(alike, 1))), float(np.median(np.diag(alike, 50)))


def values_of(records: list[Record], kind: str, metric: str) -> np.ndarray:
    return np.array(
        [each.value for each in records if (each.method, each.metric) == (kind, metric)]
    )


@pytest.mark.real
def test_simulated_phones_are_near_the_band_of_real_ones(records: list[Record]) -> None:
    for metric, beyond in {
        "kurtosis": 0.7,
        "spread (dB)": 0.5,
        "echo over direct (dB)": 0.0,
    }.items():
        real, ours = (values_of(records, kind, metric) for kind in (MEASURED, SIMULATED))
        assert real.min() - beyond < ours.min()
        assert ours.max() < real.max() + beyond


@pytest.mark.real
def test_a_phone_that_hears_no_echo_is_told_from_one_that_does(records: list[Record]) -> None:
    can = {each.world: each.value for each in records if each.metric == "can map"}
    assert can["s4_mic_onhand, 1"] == can["ordinary phone, studio"] == 1.0
    assert can["iphone5c_up_onhand, 0"] == 0.0
    found = {each.world: each.value for each in records if each.metric == "chirps found"}
    assert found["iphone5c_up_onhand, 0"] == 0.0


@pytest.mark.real
def test_repeats_of_one_phone_are_more_similar_than_chance(records: list[Record]) -> None:
    accuracy = [each.value for each in records if each.metric == "top-1 accuracy"]
    assert len(accuracy) == 2
    assert min(accuracy) > 0.5


def test_levels_are_those_planted() -> None:
    band = np.full((3, RATE_HZ // 10), 0.01)
    assert level_db(band, np.ones(3)) == pytest.approx([-40.0] * 3)


def test_a_noisier_phone_has_more_noise_after_compression() -> None:
    quiet, loud = (
        compressed_noise_rms(name) for name in ("ordinary phone", "other ordinary phone")
    )
    assert loud / quiet == pytest.approx(7e-4 / 3.6e-4)

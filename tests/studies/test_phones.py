"""Real phones beside simulated ones, in small; unknown, still and noisy ones."""

from dataclasses import fields
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from elfslam.app.settings import Settings
from elfslam.base.values import Closures, Echoes, Features, Odometry, Trajectory, Truth
from elfslam.world.circumstances import Circumstances, engine_of
from elfslam.world.device import MEASURED as MODELLED
from elfslam.world.device import built_in_device
from elfslam.world.kinds import QUIET
from elfslam.world.phone import Engine, poses_at, room_responses
from elfslam.world.recorder import phone_poses
from elfslam.world.scattering import as_measured
from elfslam.world.scene import Scene, scene_of
from elfslam.world.stroll import random_person
from elfslam.world.walker import Straying, motion_along, smooth_lap
from elfslam.world.world_file import load_world
from studies import noisy_phones, phones, unknown_phone
from studies.localization import ALWAYS_ANSWERED
from studies.located import MEDIAN_M
from studies.noisy_phones import ANSWERED, CORRECTED, FALSE, FOUND, KEPT, WALKED, Walked, _fixes
from studies.plain_features import ELF, PLAIN
from studies.realism import RATE_HZ, banded, kurtosis, response_of, spread_db
from studies.results import Record
from studies.still_phone import HAND_M, Listener, held_still, listener_in, visit
from studies.study import MEDIAN_ALIGNED, StudyContext


@pytest.fixture(scope="module")
def records(shared_data: Path) -> list[Record]:
    context = StudyContext(data=shared_data)
    return phones.measure_phones(
        context, worlds=("studio",), devices=("ordinary phone",), rooms=("studio",),
        modelled=("galaxy s4 mic 1", "iphone 5c up in hand"), places=12,
    )  # fmt: skip


@pytest.fixture(scope="module")
def studio() -> tuple[Scene, Engine]:
    room = as_measured(load_world("studio").room)
    return scene_of(room), engine_of(Circumstances(engine="diffuse"), room, 1)


def heard_along(studio: tuple[Scene, Engine], device: str) -> phones.Heard:
    """A measured phone at places along the route."""
    route_m = load_world("studio").route_m
    xy_m = np.concatenate([a + 0.5 * (b - a) for a, b in pairwise([*route_m, *route_m[:1]])])
    places = np.column_stack([xy_m.reshape(-1, 2), np.full(len(route_m), 1.2)])
    poses = poses_at(places, np.arange(len(places)) * 1.1, np.full(len(places), 0.4))
    phone = built_in_device(device)
    response = response_of(room_responses(studio[0], phone, poses, engine=studio[1]))
    return phones.as_swept(device, response, phones.compressed_noise_rms(device))


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
    assert phones.level_db(band, direct)[0] == pytest.approx(known.echo_db, abs=3.0)


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
    return np.array([at.value for at in records if (at.method, at.metric) == (kind, metric)])


@pytest.mark.real
def test_simulated_phones_are_near_the_band_of_real_ones(records: list[Record]) -> None:
    for metric, beyond in {
        "kurtosis": 0.7,
        "spread (dB)": 0.5,
        "echo over direct (dB)": 0.0,
    }.items():
        real = values_of(records, kind=phones.MEASURED, metric=metric)
        ours = values_of(records, kind=phones.SIMULATED, metric=metric)
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
    assert phones.level_db(band, np.ones(3)) == pytest.approx([-40.0] * 3)


def test_a_noisier_phone_has_more_noise_after_compression() -> None:
    quiet = phones.compressed_noise_rms("ordinary phone")
    loud = phones.compressed_noise_rms("other ordinary phone")
    assert loud / quiet == pytest.approx(7e-4 / 3.6e-4)


def test_two_orientations_help_a_phone_that_hears_backward(tmp_path: Path) -> None:
    records = unknown_phone.measure_unknown_phone(
        StudyContext(kept=tmp_path / "kept"), kind=QUIET, **unknown_phone.STUDY.fast
    )
    mean_m = {each.method: each.value for each in records if each.metric == unknown_phone.MEAN_M}
    assert mean_m["superimposed, translated"] < 0.7 * mean_m["one way, as it is"]


SPOT_M = np.array([4.0, 3.0])


@pytest.fixture(scope="module")
def listener() -> Listener:
    return listener_in(load_world("studio").room)


def test_a_hand_moves_the_phone_a_little_about_where_it_is_held() -> None:
    poses = held_still(SPOT_M, 4000, np.random.default_rng(0), height_m=1.1, yaw_rad=np.pi / 2)
    np.testing.assert_allclose(poses.position_m.mean(axis=0), [4.0, 3.0, 1.1], atol=0.001)
    np.testing.assert_allclose(poses.position_m.std(axis=0), HAND_M, rtol=0.05)
    ahead = poses.world_from_phone[:, :2, 1]
    headings = np.arctan2(ahead[:, 1], ahead[:, 0])
    assert np.degrees(headings.mean()) == pytest.approx(90.0, abs=0.2)
    assert 1.5 < np.degrees(headings.std()) < 2.5


def test_a_visit_goes_to_each_spot_in_turn(listener: Listener) -> None:
    spots_m = np.array([[1.5, 1.5], [3.0, 2.5]])
    traces = visit(listener, spots_m, 5, np.random.default_rng(2))
    assert traces.shape == (10, 2352)
    first = visit(listener, spots_m[:1], 5, np.random.default_rng(2))
    np.testing.assert_array_equal(traces[:5], first)
    away = visit(listener, spots_m[:1], 5, np.random.default_rng(2), away_m=0.05)
    assert not np.array_equal(first, away)


QUIETER, NOISY = noisy_phones.PHONES[:2]


@pytest.fixture(scope="module")
def noisy() -> list[Record]:
    """Two phones of a surveyor in the controlled scenario."""
    return noisy_phones.measure_noisy_phones(StudyContext(), kind=QUIET, **noisy_phones.STUDY.fast)


def value(noisy: list[Record], method: str, condition: str, metric: str) -> float:
    wanted = (method, condition, metric)
    (found,) = [r.value for r in noisy if (r.method, r.condition, r.metric) == wanted]
    return found


def test_a_closure_that_was_dropped_counts_as_none_and_one_of_two_places_as_false() -> None:
    t_s = np.arange(20.0)
    poses = np.column_stack([np.minimum(t_s, 19.0 - t_s), np.zeros((20, 2))])
    truth, nodes = Truth(t_s, poses), Odometry(t_s, poses, np.full((19, 3), 0.1))
    ends = (np.array([1, 3, 2]), np.array([18, 16, 10]))
    closures = Closures(*ends, np.ones(3), np.zeros((3, 3)), np.tile(np.eye(3), (3, 1, 1)))
    weights = np.array([1.0, 0.0, 1.0])
    trajectory = Trajectory(t_s, poses, np.tile(np.eye(3), (20, 1, 1)), weights, "OK")
    features = Features(t_s, np.ones((20, 1), np.float32), "planted")
    echoes = Echoes(t_s, np.zeros((20, 2352), np.float32), np.zeros((0, 2)))
    walk = Walked(nodes, echoes, Settings(), truth)
    found = noisy_phones._map_numbers(noisy_phones.Mapped(walk, features, closures, trajectory))
    assert (found[KEPT], found[FALSE]) == (2, 1)
    assert found[MEDIAN_ALIGNED] == pytest.approx(0.0, abs=1e-9)


def test_a_phone_in_which_no_chirp_is_found_maps_nothing_and_is_nowhere() -> None:
    assert noisy_phones._walk_numbers(None) == {FOUND: 0.0}
    assert list(_fixes({}, None)) == [(ELF, {ANSWERED: 0.0})]


def test_the_correction_gives_closures_to_noisy_phones_alone(noisy: list[Record]) -> None:
    def kept(phone: str) -> list[float]:
        ways = (noisy_phones.UNCORRECTED, CORRECTED)
        return [value(noisy, f"{ELF}, {how}", phone, KEPT) for how in ways]

    noise = [value(noisy, WALKED, phone, noisy_phones.OVER_NOISE) for phone in (QUIETER, NOISY)]
    assert noise[0] > noise[1] + 6
    assert kept(QUIETER)[0] == kept(QUIETER)[1] > 0
    assert kept(NOISY)[0] < kept(NOISY)[1]
    assert value(noisy, f"{ELF}, {CORRECTED}", NOISY, FALSE) == 0
    by_elf = value(noisy, f"{ELF}, {CORRECTED}", NOISY, MEDIAN_ALIGNED)
    walked = value(noisy, WALKED, NOISY, MEDIAN_ALIGNED)
    assert by_elf < walked


def test_a_noisy_phone_is_located_in_its_own_and_a_quiet_one_s_map(noisy: list[Record]) -> None:
    for whose in (f"the map by {QUIETER}", "its own map"):
        assert 0 <= value(noisy, ELF, f"{NOISY} in {whose}", ANSWERED) < 1
        for feature in (ELF, PLAIN):
            always = (ALWAYS_ANSWERED.format(feature), f"{NOISY} in {whose}")
            assert value(noisy, *always, ANSWERED) == 1
            assert value(noisy, *always, MEDIAN_M) < 3

"""Simulated rooms beside measured ones, in small: the bands that the diffuse field has to keep."""

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world.pulses import BASEBAND_HZ
from studies import realism
from studies.realism import BAND_HZ, KINDS, MOVED_M, RATE_HZ, banded, contrast, kurtosis, spread_db
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return realism.measure_realism(StudyContext(), worlds=("studio",), places=24, rooms=6)


def values_of(records: list[Record], world: str, kind: str, metric: str) -> list[float]:
    wanted = (world, KINDS[kind], metric)
    return [each.value for each in records if (each.world, each.method, each.metric) == wanted]


@pytest.mark.parametrize("room", ["studio", "6 training rooms"])
def test_a_diffuse_room_is_as_measured_ones(records: list[Record], room: str) -> None:
    assert all(2.6 < value < 4.2 for value in values_of(records, room, "diffuse", "kurtosis"))
    assert all(5.3 < value < 6.7 for value in values_of(records, room, "diffuse", "spread (dB)"))
    assert 100 < values_of(records, room, "diffuse", "T60 (ms)")[0] < 200
    contrast = values_of(records, room, "diffuse", "contrast")
    assert 0.1 < contrast[MOVED_M.index(0.025)] < 0.5


def test_a_room_of_mirrors_is_not(records: list[Record]) -> None:
    assert values_of(records, "studio", "images", "kurtosis")[0] > 4.5


@pytest.mark.parametrize("kind", KINDS)
def test_the_farther_the_less_alike(records: list[Record], kind: str) -> None:
    kept = values_of(records, "studio", kind, "contrast")
    assert kept[0] > kept[1] > kept[-1]


def test_a_response_is_its_envelope_on_the_carrier() -> None:
    envelope = np.zeros((1, 630), dtype=np.complex64)
    envelope[0, 63] = 1.0
    response = realism.response_of(envelope)[0]
    assert np.abs(response).argmax() == pytest.approx(63 / BASEBAND_HZ * RATE_HZ, abs=1)


MEASURED_HZ = 48_000


def decaying_noise(t60_s: float, count: int = 40) -> F64:
    t_s = np.arange(round(0.12 * MEASURED_HZ)) / MEASURED_HZ
    noise = np.random.default_rng(0).standard_normal((count, len(t_s)))
    return np.asarray(noise * 10 ** (-3 * t_s / t60_s))


def test_a_diffuse_field_has_kurtosis_three_and_a_rayleigh_envelope() -> None:
    band = banded(decaying_noise(0.2), MEASURED_HZ)
    assert kurtosis(band, MEASURED_HZ) == pytest.approx([2.7] * 3, abs=0.15)
    assert spread_db(band, MEASURED_HZ) == pytest.approx([5.4] * 3, abs=0.35)


def test_sparse_reflections_have_more_of_both() -> None:
    noise, generator = decaying_noise(0.2), np.random.default_rng(1)
    band = banded(noise * (generator.uniform(size=noise.shape) < 0.02), MEASURED_HZ)
    assert min(kurtosis(band, MEASURED_HZ)) > 3.5
    assert min(spread_db(band, MEASURED_HZ)) > 6.5


@pytest.mark.parametrize("t60_s", [0.1, 0.15, 0.2])
def test_a_decay_is_told_even_where_it_is_cut(t60_s: float) -> None:
    band = banded(decaying_noise(t60_s), MEASURED_HZ)
    assert realism.reverberation_s(band, MEASURED_HZ) == pytest.approx(t60_s, rel=0.1)


def test_only_the_band_counts() -> None:
    t_s = np.arange(3000) / MEASURED_HZ
    within, below = (np.sin(2 * np.pi * hz * t_s)[None] for hz in (17_500.0, 12_000.0))
    assert BAND_HZ[0] > 12_000
    assert np.abs(banded(within, MEASURED_HZ)[0, 1000:1400]).max() == pytest.approx(1.0, abs=0.05)
    assert np.abs(banded(below, MEASURED_HZ)[0, 1000:1400]).max() < 1e-3


def test_contrast_is_one_for_the_same_and_nothing_for_others() -> None:
    features = np.random.default_rng(2).standard_normal((60, 200)) + 0.5
    features /= np.linalg.norm(features, axis=1, keepdims=True)
    assert contrast(features, features) == pytest.approx(1.0)
    assert contrast(features, np.roll(features, 1, axis=0)) == pytest.approx(0.0, abs=0.05)

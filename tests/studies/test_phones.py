"""Real phones beside simulated ones, in small."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from studies.phones import (
    MEASURED,
    SIMULATED,
    compressed_noise_rms,
    level_db,
    measure_phones,
)
from studies.realism import RATE_HZ
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def records(shared_data: Path) -> list[Record]:
    context = StudyContext(data=shared_data)
    return measure_phones(context, worlds=("studio",), devices=("ordinary phone",), places=12)


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

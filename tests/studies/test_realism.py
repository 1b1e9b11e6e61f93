"""Simulated rooms beside measured ones, in small: the bands that the diffuse field has to keep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.world.pulses import BASEBAND_HZ
from studies.realism import KINDS, MOVED_M, RATE_HZ, measure_realism, response_of
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return measure_realism(StudyContext(), worlds=("studio",), places=24, rooms=6)


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
    assert kept[0] > kept[3] > kept[-1]


def test_measured_rooms_stand_beside(shared_data: Path) -> None:
    records = measure_realism(StudyContext(shared_data), worlds=(), places=4, rooms=2)
    contrasts = [r.value for r in records if (r.method, r.metric) == ("measured", "contrast")]
    assert len(contrasts) == 4
    assert min(contrasts) > 0.1


def test_a_response_is_its_envelope_on_the_carrier() -> None:
    envelope = np.zeros((1, 630), dtype=np.complex64)
    envelope[0, 63] = 1.0
    response = response_of(envelope)[0]
    assert np.abs(response).argmax() == pytest.approx(63 / BASEBAND_HZ * RATE_HZ, abs=1)

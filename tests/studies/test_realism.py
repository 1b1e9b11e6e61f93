"""Simulated rooms beside measured ones, in small: the bands that the diffuse field has to keep."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.world.pulses import BASEBAND_HZ
from studies.finding import Finding, Given, Row
from studies.realism import KINDS, MOVED_M, RATE_HZ, measure_realism, response_of

pytestmark = pytest.mark.real


@pytest.fixture(scope="module")
def finding() -> Finding:
    return measure_realism(Given(), worlds=("studio",), places=24, rooms=6)


def row_of(finding: Finding, room: str, kind: str) -> Row:
    [row] = [r for r in finding.rows if r["room"] == room and r["sound"] == KINDS[kind]]
    return row


@pytest.mark.parametrize("room", ["studio", "6 training rooms"])
def test_a_diffuse_room_is_as_measured_ones(finding: Finding, room: str) -> None:
    row = row_of(finding, room, "diffuse")
    kurtosis, spread_db = (
        [float(part) for part in str(row[what]).split("/")] for what in ("kurtosis", "spread (dB)")
    )
    assert all(2.6 < value < 4.2 for value in kurtosis)
    assert all(5.3 < value < 6.7 for value in spread_db)
    assert 100 < float(str(row["T60 (ms)"])) < 200
    assert 0.1 < float(str(row["contrast 2.5 cm"])) < 0.5


def test_a_room_of_mirrors_is_not(finding: Finding) -> None:
    row = row_of(finding, "studio", "images")
    assert float(str(row["kurtosis"]).split("/")[0]) > 4.5


@pytest.mark.parametrize("kind", KINDS)
def test_the_farther_the_less_alike(finding: Finding, kind: str) -> None:
    row = row_of(finding, "studio", kind)
    kept = [float(str(row[f"contrast {100 * far:g} cm"])) for far in MOVED_M]
    assert kept[0] > kept[3] > kept[-1]


def test_measured_rooms_stand_beside(shared_data: Path) -> None:
    rows = measure_realism(Given(shared_data), worlds=(), places=4, rooms=2).rows
    assert [row["sound"] for row in rows].count("measured") == 4
    assert float(str(rows[0]["contrast 2.5 cm"])) > 0.1


def test_a_response_is_its_envelope_on_the_carrier() -> None:
    envelope = np.zeros((1, 630), dtype=np.complex64)
    envelope[0, 63] = 1.0
    response = response_of(envelope)[0]
    assert np.abs(response).argmax() == pytest.approx(63 / BASEBAND_HZ * RATE_HZ, abs=1)

"""The stability of spectra: planted ones, and a few spots of the lab."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.scoring.page import Panel
from elfslam.world.world_file import load_world
from studies.finding import Row
from studies.stability import (
    AGE,
    ELSEWHERE,
    HEIGHT,
    LEVEL,
    PLACE,
    SWEEPS,
    WHOLE,
    YAW,
    compared,
    compared_elsewhere,
    measure_stability,
)

SPECTRA_DB = np.random.default_rng(0).normal(-40, 3, (5, 71))


def test_a_louder_spectrum_correlates_all_the_same() -> None:
    found = compared(SPECTRA_DB, SPECTRA_DB + 3.0)
    np.testing.assert_allclose(found[WHOLE], 1.0)
    np.testing.assert_allclose(found[PLACE], 1.0)
    np.testing.assert_allclose(found[LEVEL], 3.0)


def test_what_all_spots_share_is_the_phones() -> None:
    phone = 20 * np.sin(np.linspace(0, 3, 71))
    elsewhere = compared_elsewhere(SPECTRA_DB + phone)
    assert elsewhere[WHOLE].min() > 0.5
    assert elsewhere[PLACE].max() < 0.1
    assert elsewhere[LEVEL].shape == (5,)


@pytest.fixture(scope="module")
def found() -> tuple[list[Row], list[Panel]]:
    return measure_stability(load_world("lab"), 6)


def test_every_value_has_a_row_of_each_measure(found: tuple[list[Row], list[Panel]]) -> None:
    rows, panels = found
    assert len(rows) == 3 * (sum(map(len, SWEEPS.values())) + 1)
    assert {row["over"] for row in rows} == {"6 spots"}
    assert len(panels) == 2 * len(SWEEPS)
    for row in rows:
        assert row["from"] <= row["mean"] <= row["to"]  # type: ignore[operator]


def test_a_spot_is_itself_again_and_not_another(found: tuple[list[Row], list[Panel]]) -> None:
    means = {
        (row["varied"], row["at"], row["measure"]): float(str(row["mean"])) for row in found[0]
    }
    for varied, first in ((HEIGHT, 100), (YAW, 0), (AGE, 0)):
        for measure in (WHOLE, PLACE):
            assert means[varied, first, measure] > means[ELSEWHERE, None, measure] + 0.005
        assert means[varied, first, LEVEL] < means[ELSEWHERE, None, LEVEL]
    assert means[YAW, 180, PLACE] < means[YAW, 10, PLACE]
    assert means[AGE, 30, PLACE] > means[YAW, 180, PLACE]

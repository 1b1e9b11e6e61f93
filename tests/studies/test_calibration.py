"""The study of calibration, in miniature."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.line.feature import load_encoder
from studies.calibration import measure_calibration, pairs_of
from studies.finding import Finding


def test_pairs_are_near_and_of_one_heading_or_far() -> None:
    mapped = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 3.1]])
    query = np.array(
        [[0.2, 0.0, 0.5], [0.2, 0.0, 0.7], [0.0, 0.6, 0.0], [0.0, 1.2, 0.0], [5.0, 0.0, -3.1]]
    )
    same, elsewhere = pairs_of(mapped, query)
    assert same.tolist() == [[True, False, False, False, False], [False] * 4 + [True]]
    assert elsewhere.tolist() == [[False, False, False, True, True], [True] * 4 + [False]]


@pytest.fixture(scope="module")
def finding() -> Finding:
    return measure_calibration(
        None,
        lambda what, share: None,
        worlds=("studio",),
        seeds=(108,),
        phones=("simulated phone", "tablet"),
        rounds=1,
        encoders={"ELF": load_encoder("compact")},
    )


def test_a_row_for_each_phone(finding: Finding) -> None:
    assert [row["phone"] for row in finding.rows] == ["simulated phone", "tablet"]
    for row in finding.rows:
        assert (row["world"], row["encoder"], row["walks"]) == ("studio", "ELF", 1)
        assert row["gain"] == pytest.approx(row["calibrated"] - row["plain"], abs=2e-3)  # type: ignore[operator]
        low, high = map(float, str(row["plain, 95 %"]).split(" to "))
        assert low == high == row["plain"], "of a single walk there is no spread"


def test_the_own_phone_loses_little_and_a_stranger_is_known(finding: Finding) -> None:
    own, tablet = finding.rows
    assert abs(float(str(own["gain"]))) < 0.1
    assert float(str(tablet["calibrated"])) > 0.4


def test_every_world_has_its_panel(finding: Finding) -> None:
    assert finding.page is not None
    assert [panel.title for panel in finding.page.panels] == ["studio: ELF", "In figures"]

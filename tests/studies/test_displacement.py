"""Likeness against displacement, in small, and recall of planted places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plotly.graph_objects as go
import pytest

from elfslam.baselines.generic import unit_rows
from studies.displacement import MOVED_M, measure_displacement, recall
from studies.finding import Finding, Given
from studies.plain_features import PLAIN, compared_encoders

pytestmark = pytest.mark.real


@pytest.fixture(scope="module")
def finding() -> Finding:
    mine = {"mine": compared_encoders()[PLAIN]}
    return measure_displacement(Given(), worlds=("studio",), places=24, encoders=mine)


def curve(finding: Finding, measure: str, feature: str) -> list[float]:
    rows = [row for row in finding.rows if row["measure"] == measure]
    assert [row["moved (cm)"] for row in rows] == [100 * far for far in MOVED_M]
    return [float(str(row[feature])) for row in rows]


def test_the_farther_the_less_alike(finding: Finding) -> None:
    for feature in ("ELF", "plain spectrogram"):
        alike = curve(finding, "likeness", feature)
        assert alike[0] > alike[4] > alike[6] > alike[8]
    assert finding.page is not None


def test_the_elf_knows_a_place_from_a_decimetre_away(finding: Finding) -> None:
    elf, plain = (curve(finding, "recall", name) for name in ("ELF", "plain spectrogram"))
    assert elf[4] > 0.8 > plain[4]
    assert elf[8] < 0.5


def test_an_encoder_given_by_name_stands_beside(finding: Finding) -> None:
    assert curve(finding, "recall", "mine") == curve(finding, "recall", PLAIN)
    assert finding.page is not None
    figure = finding.page.panels[0].body
    assert isinstance(figure, go.Figure)
    assert "mine" in [trace.name for trace in figure.data]


def test_measured_places_stand_beside(shared_data: Path) -> None:
    rows = measure_displacement(Given(shared_data), worlds=()).rows
    assert [row["sound"] for row in rows].count("measured") == 2 * 4
    assert all(row["moved (cm)"] == 2.5 for row in rows)


def test_recall_counts_what_is_more_alike_than_others() -> None:
    generator = np.random.default_rng(4)
    here = unit_rows(generator.standard_normal((200, 64)).astype(np.float32))
    other = ~np.eye(200, dtype=bool)
    moved = here.copy()
    moved[:50] = here[::-1][:50]
    assert recall(here, moved, other) == pytest.approx(0.75)

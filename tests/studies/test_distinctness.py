"""The distinctness study on a few spots."""

from __future__ import annotations

import numpy as np
import pytest

from studies.distinctness import SPOTS_SHOWN, _row_of_spots, measure_distinctness
from studies.finding import Finding, Given


@pytest.fixture(scope="module")
def finding() -> Finding:
    return measure_distinctness(Given(), spots=10)


def test_a_chirp_tells_spots_apart_better_than_a_tone(finding: Finding) -> None:
    chirp, tone = finding.rows
    assert (chirp["signal"], tone["signal"], chirp["spots"]) == ("chirp", "tone", 10)
    assert chirp["recognised"] > tone["recognised"]  # type: ignore[operator]
    assert chirp["mean error (m)"] <= tone["mean error (m)"]  # type: ignore[operator]
    for row in finding.rows:
        assert row["from"] <= row["recognised"] <= row["to"]  # type: ignore[operator]


def test_the_page_shows_a_cloud_for_every_spot_and_signal(finding: Finding) -> None:
    assert finding.page is not None
    chirp, tone, table = finding.page.panels
    for panel in (chirp, tone):
        assert len(panel.body.data) == SPOTS_SHOWN  # type: ignore[union-attr]
    assert "chirp" in str(table.body)


def test_a_study_repeats_itself(finding: Finding) -> None:
    assert measure_distinctness(Given(), spots=10).rows == finding.rows


def test_five_spots_in_a_line_are_found() -> None:
    grid = np.stack(np.meshgrid(np.arange(3) * 4.0, np.arange(8) * 1.0), axis=-1).reshape(-1, 2)
    chosen = grid[_row_of_spots(grid)]
    np.testing.assert_allclose(np.diff(chosen, axis=0), np.tile([0.0, 1.0], (SPOTS_SHOWN - 1, 1)))

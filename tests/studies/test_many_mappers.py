"""Maps of many people, in small: on the plan, one map, and a row for each way of asking."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.values import Fixes
from elfslam.scoring.page import save_page
from elfslam.world.kinds import QUIET
from studies.finding import Finding, Given
from studies.many_mappers import (
    MAPPED_WAY,
    METHODS,
    WAYS,
    _most_alike,
    measure_many_mappers,
)


@pytest.fixture(scope="module")
def finding() -> Finding:
    small = {"worlds": ("studio",), "seeds": (100, 101), "counts": (1, 2), "taps": (4,)}
    return measure_many_mappers(Given(), kind=QUIET, **small)


def test_every_way_has_a_row_for_each_map(finding: Finding) -> None:
    assert [(row["laps"], row["strangers walk"], row["method"]) for row in finding.rows] == [
        (laps, way, method) for laps in (2, 4) for way in WAYS for method in METHODS
    ]


def test_both_walks_are_one_map_and_strangers_are_found_in_it(finding: Finding) -> None:
    rows = [row for row in finding.rows if row["strangers walk"] == MAPPED_WAY]
    both = {row["method"]: row for row in rows if row["laps"] == 4}
    assert both["track"]["merged"] == 2
    assert float(str(both["track"]["map (m)"])) < 0.4
    assert float(str(both["track"]["median (m)"])) < 0.5
    assert float(str(both["track"]["answered"])) > 0.5
    assert both["plain spectrogram, always answered"]["answered"] == 1.0


def test_its_page_is_written(finding: Finding, tmp_path: Path) -> None:
    assert finding.page is not None
    save_page(tmp_path / "page.html", finding.page)
    assert (tmp_path / "page.html").stat().st_size > 1000


def test_of_several_maps_the_most_alike_answers() -> None:
    def fixes(x_m: float, score: list[float]) -> Fixes:
        count = len(score)
        return Fixes(
            np.arange(float(count)),
            np.full((count, 2), x_m),
            np.zeros(count),
            np.tile(np.eye(2), (count, 1, 1)),
            np.array(score),
            np.zeros(count, dtype=np.int64),
        )

    best = _most_alike([fixes(1.0, [0.9, 0.2, np.nan]), fixes(2.0, [0.1, 0.8, 0.3])])
    assert best.xy_m[:, 0].tolist() == [1.0, 2.0, 2.0]
    assert best.score.tolist() == [0.9, 0.8, 0.3]

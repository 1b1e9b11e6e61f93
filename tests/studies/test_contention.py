"""The study of contention: fixes from sparse echoes, and a small run: what slots are worth."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.line.locate import LocateParameters
from studies.contention import WAYS, measure_contention, together
from studies.finding import Finding, Given


def test_echoes_make_a_fix_once_they_are_enough_and_last_long_enough() -> None:
    known = LocateParameters()
    dense = together(np.arange(0, 3, 0.1), known)
    assert [len(rows) for rows in dense] == [6] * 5
    assert [len(rows) for rows in together(np.arange(0, 4, 0.5), known)] == [2] * 4
    assert together(np.array([0.0, 2.1, 4.3]), known) == []


@pytest.fixture(scope="module")
def finding() -> Finding:
    made = measure_contention(
        Given(), places=("studio",), seeds=(100,), counts=(2,),
        seconds=30.0, mapping_rounds=1,
    )  # fmt: skip
    assert isinstance(made, Finding)
    return made


def test_turns_spoil_less_than_chirping_at_will(finding: Finding) -> None:
    rows = {row["way"]: row for row in finding.rows}
    assert tuple(rows) == WAYS
    at_will, turns = rows[WAYS[0]], rows[WAYS[2]]
    assert float(str(at_will["spoiled"])) > 0.2
    assert float(str(turns["spoiled"])) < 0.3 * float(str(at_will["spoiled"]))
    assert float(str(turns["chirps/s"])) < float(str(at_will["chirps/s"]))
    assert float(str(turns["clean chirps/s"])) > float(str(at_will["clean chirps/s"]))


def test_its_page_shows_every_measure(finding: Finding) -> None:
    assert finding.page is not None
    assert len(finding.page.panels) == 5

"""The study of contention: fixes from sparse echoes, and a small run: what slots are worth."""

import numpy as np

from elfslam.stages.locate import LocateParameters
from studies.contention import measure_contention, together
from studies.study import StudyContext


def test_echoes_make_a_fix_once_they_are_enough_and_last_long_enough() -> None:
    known = LocateParameters()
    dense = together(np.arange(0, 3, 0.1), known)
    assert [len(rows) for rows in dense] == [6] * 5
    assert [len(rows) for rows in together(np.arange(0, 4, 0.5), known)] == [2] * 4
    assert together(np.array([0.0, 2.1, 4.3]), known) == []


def test_turns_spoil_less_than_chirping_at_will() -> None:
    records = measure_contention(
        StudyContext(), places=("studio",), seeds=(100,), counts=(2,), seconds=30.0,
        mapping_rounds=1,
    )  # fmt: skip
    found = {(each.method, each.metric): each.value for each in records}
    spoiled, clean = "spoiled frames (%)", "clean chirps (1/s)"
    assert found["at will", spoiled] > 20
    assert found["in turns", spoiled] < 0.3 * found["at will", spoiled]
    assert found["in turns", clean] > found["at will", clean]

"""Closures step by step, on one small walk."""

import pytest

from elfslam.world.kinds import QUIET
from studies.closures import (
    ACCEPTED,
    MEDIAN_BELIEVED,
    NEAREST,
    PAPER,
    SEQUENCE,
    STUDY,
    measure_closures,
)
from studies.results import Record
from studies.study import StudyContext


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return measure_closures(StudyContext(), kind=QUIET, **STUDY.fast)


def value(records: list[Record], method: str, condition: str, metric: str) -> float:
    wanted = (method, condition, metric)
    [found] = [r.value for r in records if (r.method, r.condition, r.metric) == wanted]
    return found


def test_every_step_leaves_less_and_is_more_right(records: list[Record]) -> None:
    steps = ("ridges", "within the gate", "ratio test passed", ACCEPTED)
    recall, precision = (
        [value(records, SEQUENCE, step, metric) for step in steps]
        for metric in ("recall", "precision")
    )
    assert recall == sorted(recall, reverse=True)
    assert precision == sorted(precision)
    assert precision[-1] > 0.9


def test_symmetry_drops_some_of_what_lies_on_lines(records: list[Record]) -> None:
    on_lines = value(records, PAPER, "on a line in its slice", "recall")
    assert 0 < value(records, PAPER, "symmetric, one per line", "recall") < on_lines


def test_sequences_may_be_accepted_whole_and_nearest_neighbours_not(records: list[Record]) -> None:
    sequences, nearest = (
        value(records, method, ACCEPTED, MEDIAN_BELIEVED) for method in (SEQUENCE, NEAREST)
    )
    assert sequences < nearest

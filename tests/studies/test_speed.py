"""The speed study on a small scale: its ratios are those of its rates, and ours is the faster."""

from __future__ import annotations

import pytest

from studies.speed import (
    EMPTY,
    ENGINES,
    FURNISHED,
    OURS,
    OURS_DIFFUSE,
    PYROOM,
    RATE,
    TIMES,
    measure_speed,
)
from studies.study import StudyContext


def test_ratios_are_those_of_the_rates_and_every_stream_took_time() -> None:
    records = measure_speed(StudyContext(), echoes=40, stream=600)
    found = {(each.method, each.metric, each.condition): each.value for each in records}
    assert all(value > 0 for value in found.values())
    ratio = found[OURS, RATE, EMPTY] / found[PYROOM, RATE, EMPTY]
    assert found[OURS, TIMES, EMPTY] == pytest.approx(ratio)
    assert found[OURS_DIFFUSE, TIMES, FURNISHED] > 1
    streams = {each.method for each in records if each.metric == "time (min)"}
    assert streams == {f"training stream, {engine}" for engine in ENGINES}

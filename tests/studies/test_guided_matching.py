"""Guided matching in miniature: ratios as planted, and further returns are found."""

from collections.abc import Sequence

import numpy as np
import pytest

from elfslam.world.kinds import PEOPLE
from studies.cached import SimulatedWalk
from studies.guided_matching import (
    ALL_WORLDS,
    EQUAL,
    GUIDED,
    RATIO,
    STUDY,
    WEIGHED,
    _logarithms,
    _ratio,
    measure_guided_matching,
)
from studies.plain_features import ELF, PLAIN
from studies.results import Record, averaged
from studies.study import MEDIAN_ALIGNED, StudyContext


def walk(world: str, before_m: float, after_m: float) -> list[Record]:
    numbers = {WEIGHED: {MEDIAN_ALIGNED: before_m}, GUIDED: {MEDIAN_ALIGNED: after_m}}
    return list(_logarithms(SimulatedWalk(world, 120, 4, PEOPLE.name), ELF, numbers))


def test_ratios_are_geometric_means_of_each_world_and_of_all() -> None:
    walks = [walk("studio", 0.2, 0.1), walk("studio", 0.2, 0.4), walk("hall", 1.0, 0.125)]
    found = [_ratio(each) for each in averaged(walks, (120, 121))]
    assert {each.world: each.value for each in found} == pytest.approx(
        {"studio": 1.0, "hall": 0.125, ALL_WORLDS: 0.5}
    )
    (pooled,) = [each for each in found if each.world == ALL_WORLDS]
    assert pooled.low == pytest.approx(0.125)
    assert pooled.high == pytest.approx(2.0)
    assert {each.condition for each in found} == {GUIDED}


def value(records: Sequence[Record], method: str, condition: str, metric: str) -> float:
    (found,) = [
        each.value
        for each in records
        if (each.method, each.condition, each.metric) == (method, condition, metric)
        and each.world != ALL_WORLDS
    ]
    return found


def test_a_first_solution_leads_to_further_returns_by_every_feature() -> None:
    records = measure_guided_matching(StudyContext(), kind=PEOPLE, **STUDY.fast)
    for feature in (ELF, PLAIN):
        before, after = (value(records, feature, each, "recall") for each in (WEIGHED, GUIDED))
        assert before <= after
        error_m = [value(records, feature, each, MEDIAN_ALIGNED) for each in (WEIGHED, EQUAL)]
        ratio = value(records, feature, EQUAL, RATIO)
        assert ratio == pytest.approx(error_m[1] / error_m[0])
    assert np.isfinite(value(records, "magnetic", GUIDED, RATIO))

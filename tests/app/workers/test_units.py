"""A unit of work is known by its inputs, all of them and nothing else."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from functools import partial
from typing import Any

import pytest

from elfslam.app.workers import silent_elsewhere, unit_key


@dataclass(frozen=True)
class Walk:
    world: str
    seed: int


def measure(walk: Walk, rounds: int = 1, announce: object = None) -> int:
    return walk.seed * rounds


def other(walk: Walk) -> int:
    return 0


WALK = Walk("studio", 1)


def test_the_same_inputs_have_the_same_key() -> None:
    assert unit_key(measure, WALK) == unit_key(measure, Walk("studio", 1))
    assert len(unit_key(measure, WALK)) == 24


@pytest.mark.parametrize(
    ("do", "task"),
    [
        (measure, Walk("studio", 2)),
        (measure, Walk("lounge", 1)),
        (other, WALK),
        (partial(measure, rounds=2), WALK),
        (partial(measure, rounds=[other]), WALK),
        (partial(measure, rounds={"a": measure}), WALK),
    ],
)
def test_another_input_has_another_key(do: Any, task: Walk) -> None:
    assert unit_key(do, task) != unit_key(measure, WALK)


def test_functions_count_by_name_and_not_by_where_they_lie() -> None:
    """An address would make the same run another one."""
    known = unit_key(partial(measure, rounds={"a": other}), WALK)
    assert known != unit_key(partial(measure, rounds={"a": measure}), WALK)
    assert known != unit_key(partial(measure, rounds={"b": other}), WALK)


def test_who_hears_of_it_is_no_input() -> None:
    told = partial(measure, announce=silent_elsewhere(print))
    assert unit_key(told, WALK) == unit_key(partial(measure), WALK)


def test_an_announcement_is_heard_here_and_nowhere_else(capsys: pytest.CaptureFixture[str]) -> None:
    here = silent_elsewhere(print)
    elsewhere = pickle.loads(pickle.dumps(here))
    elsewhere("walking", 0.1)
    here("mapping", 0.5)
    assert capsys.readouterr().out == "mapping 0.5\n"
    assert silent_elsewhere(here) is here

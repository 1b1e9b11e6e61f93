"""The figures of the README in small: one table, and a planted defect turns it red."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest

from elfslam.base.values import NO_CLOSURES
from elfslam.slam import pipeline
from studies import headline
from studies.headline import FIGURES, MAPPED, RECKONED, TASKS, Figure, Task, judged, main

SMALL = (Task("studio", 100, rounds=2, locate=True),)
QUIET: Callable[..., Any] = lambda what, share: None  # noqa: E731


def test_every_figure_is_measured_by_some_walk() -> None:
    names = {(task.world, name) for task in TASKS for name in (RECKONED, MAPPED)}
    names |= {(task.world, mode.value) for task in TASKS if task.locate for mode in headline.MODES}
    assert {(figure.world, figure.name) for figure in FIGURES} == names
    assert len(FIGURES) == len(names)


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: f"{figure.world} {figure.name}")
def test_a_figure_twice_as_bad_is_red(figure: Figure) -> None:
    def verdict(value_m: float) -> object:
        return judged({(figure.world, figure.name): value_m}, [figure])[0]["verdict"]

    assert verdict(figure.expected_m) == headline.OK
    assert verdict(2 * figure.expected_m) == headline.RED
    assert verdict(math.nan) == headline.RED


def test_closures_switched_off_turn_it_red(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = headline.measure_headline(QUIET, tasks=SMALL)
    assert found["studio", MAPPED] < 0.5 * found["studio", RECKONED]
    figures = [Figure(world, name, value_m) for (world, name), value_m in found.items()]
    monkeypatch.setattr(headline, "FIGURES", figures)
    measure = headline.measure_headline
    monkeypatch.setattr(
        headline, "measure_headline", lambda say, workers: measure(say, tasks=SMALL)
    )
    assert main(["--on", "1"]) == 0
    monkeypatch.setattr(pipeline, "closures_by", lambda *_: NO_CLOSURES)
    assert main(["--on", "1"]) == 1
    table = capsys.readouterr().out
    assert headline.RED in table

"""The figures of the README in small: one table, and a planted defect turns it red."""

import math

import pytest

from elfslam.base.enums import Mode
from elfslam.base.values import NO_CLOSURES
from elfslam.slam import pipeline
from studies import headline
from studies.catalogue import Stale
from studies.headline import FIGURES, MAPPED, RECKONED, TASKS, Figure, Task, judged, main
from studies.study import StudyContext

SMALL = (Task("studio", 100, rounds=4, modes=(Mode.ONE_SHOT, Mode.TRACK)),)


def test_every_figure_is_measured_by_some_walk() -> None:
    walks = {(task.world, task.kind, task.modes) for task in TASKS}
    names = {(*walk, name) for *walk, _ in walks for name in (RECKONED, MAPPED)}
    names |= {(*walk, mode.value) for *walk, modes in walks for mode in modes}
    assert {(figure.world, figure.kind, figure.name) for figure in FIGURES} == names
    assert len(FIGURES) == len(names)


def test_a_figure_twice_as_bad_is_red() -> None:
    def verdicts(times: float) -> set[object]:
        found = {(each.world, each.kind, each.name): times * each.expected_m for each in FIGURES}
        return {row["verdict"] for row in judged(found, FIGURES)}

    assert verdicts(1.0) == {headline.OK}
    assert verdicts(2.0) == verdicts(math.nan) == {headline.RED}


def test_closures_switched_off_turn_it_red(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found = headline.measure_headline(StudyContext(), tasks=SMALL)
    mapped_m, reckoned_m = (found["studio", "surveyor", name] for name in (MAPPED, RECKONED))
    assert mapped_m < 0.5 * reckoned_m
    figures = [Figure(*named, value_m) for named, value_m in found.items()]
    monkeypatch.setattr(headline, "FIGURES", figures)
    measure = headline.measure_headline
    monkeypatch.setattr(headline, "measure_headline", lambda context: found)
    monkeypatch.setattr(headline, "stale_studies", lambda *_: [])
    assert main(["--on", "1", "--strict"]) == 0
    monkeypatch.setattr(headline, "stale_studies", lambda *_: [Stale("gait", None, "never", 1.0)])
    assert main(["--on", "1"]) == 0
    assert headline.RED in capsys.readouterr().out
    assert main(["--on", "1", "--strict"]) == 1
    monkeypatch.setattr(headline, "measure_headline", lambda context: measure(context, tasks=SMALL))
    monkeypatch.setattr(pipeline, "closures_by", lambda *_: NO_CLOSURES)
    assert main(["--on", "1"]) == 1
    table = capsys.readouterr().out
    assert headline.RED in table

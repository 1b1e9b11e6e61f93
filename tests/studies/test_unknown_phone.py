"""Unknown phones in miniature."""

from __future__ import annotations

from pathlib import Path
from typing import NoReturn

import pytest

from elfslam.world.circumstances import Circumstances
from elfslam.world.kinds import DAYS_LATER, MAPPING_PHONE, QUIET, SURVEYOR
from studies import unknown_phone
from studies.study import StudyContext
from studies.unknown_phone import MEAN_M, STUDY, Place, measure_unknown_phone


def test_two_orientations_help_a_phone_that_hears_backward(tmp_path: Path) -> None:
    records = measure_unknown_phone(StudyContext(kept=tmp_path / "kept"), kind=QUIET, **STUDY.fast)
    mean_m = {each.method: each.value for each in records if each.metric == MEAN_M}
    assert mean_m["superimposed, translated"] < 0.7 * mean_m["one way, as it is"]


def test_who_is_located_comes_later_and_with_the_phone(monkeypatch: pytest.MonkeyPatch) -> None:
    days: list[tuple[str, int]] = []

    def listen(*_: object, circumstances: Circumstances, **__: object) -> NoReturn:
        days.append((circumstances.device, circumstances.day))
        raise InterruptedError

    monkeypatch.setattr(unknown_phone, "simulate", listen)
    task = Place("studio", 110, SURVEYOR.name)
    for phone in (None, "cheap"):
        with pytest.raises(InterruptedError):
            unknown_phone._walk(task, 110, 1, phone=phone)
    assert days == [(MAPPING_PHONE, 0), ("cheap", DAYS_LATER)]

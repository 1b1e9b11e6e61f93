"""Thresholds of fixes, in small: the higher, the fewer answers, here and elsewhere."""

import pytest

from elfslam.base.enums import Mode
from studies import fix_thresholds
from studies.fix_thresholds import STUDY, measure_fix_thresholds
from studies.localization import ANSWERED_ELSEWHERE
from studies.study import StudyContext


def test_higher_thresholds_answer_less(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fix_thresholds, "UNKNOWN_BELOW", (0.4, 0.6, 0.78))
    monkeypatch.setattr(fix_thresholds, "KINDS", ("quiet",))
    records = measure_fix_thresholds(StudyContext(), **STUDY.fast)
    for mode in Mode:
        for metric in ("answered", ANSWERED_ELSEWHERE):
            shares = [
                each.value for each in records
                if (each.method, each.metric) == (mode.value, metric)
            ]  # fmt: skip
            assert len(shares) == 3
            assert shares == sorted(shares, reverse=True)

"""Thresholds of loops: planted ratios choose the best one, and closures by it help."""

import pytest

from elfslam.app.settings import Settings
from studies.plain_features import CLOSURE_THRESHOLDS, ELF, closing_by, compared_encoders
from studies.results import Record
from studies.study import StudyContext
from studies.thresholds import BEST, RATIO, STUDY, _ratios, measure_thresholds


def planted(feature: str, **ratios: float) -> list[Record]:
    return [Record(feature, RATIO, value, condition=name[1:]) for name, value in ratios.items()]


def test_the_best_threshold_has_the_least_geometric_mean() -> None:
    walks = [
        [*planted("a", _1=0.5, _2=0.2), *planted("b", _1=0.9, _2=1.0)],
        [*planted("a", _1=0.5, _2=0.4), *planted("b", _1=0.1, _2=0.2)],
    ]
    found = _ratios(walks, (0, 1))
    assert [each.value for each in found if each.metric == RATIO] == pytest.approx(
        [0.5, 0.283, 0.3, 0.447], abs=1e-3
    )
    assert {each.method: each.value for each in found if each.metric == BEST} == {"a": 2, "b": 1}


def test_the_elf_closes_as_the_pipeline_does_by_itself() -> None:
    assert set(CLOSURE_THRESHOLDS) == set(compared_encoders())
    assert closing_by(ELF, Settings()) == Settings().closure


def test_a_prior_lowers_the_threshold_of_each_feature_by_the_same_share() -> None:
    for feature, threshold in CLOSURE_THRESHOLDS.items():
        closing, elf = closing_by(feature, Settings()), Settings().closure
        assert closing.threshold == threshold
        lowered, by_elf = (4.0 / (each.score_evidence * each.threshold) for each in (closing, elf))
        assert lowered == pytest.approx(by_elf)
        fall, of_elf = (each.sigma_fall * each.threshold for each in (closing, elf))
        assert fall == pytest.approx(of_elf)


def test_closures_help_at_the_best_threshold() -> None:
    records = measure_thresholds(StudyContext(), **STUDY.fast)
    ratios = [r.value for r in records if (r.method, r.metric) == (ELF, RATIO)]
    assert len(ratios) == len(STUDY.fast["thresholds"])
    assert min(ratios) < 0.7

"""Unknown phones in miniature."""

from pathlib import Path

from elfslam.world.kinds import QUIET
from studies.study import StudyContext
from studies.unknown_phone import MEAN_M, STUDY, measure_unknown_phone


def test_two_orientations_help_a_phone_that_hears_backward(tmp_path: Path) -> None:
    records = measure_unknown_phone(StudyContext(kept=tmp_path / "kept"), kind=QUIET, **STUDY.fast)
    mean_m = {each.method: each.value for each in records if each.metric == MEAN_M}
    assert mean_m["superimposed, translated"] < 0.7 * mean_m["one way, as it is"]

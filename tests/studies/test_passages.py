"""The study of walks followed through plans, in small."""

from elfslam.world.kinds import QUIET
from studies.passages import ECHOES, GIVEN_START, MATCHED, MEDIAN, STEPS, STUDY, measure_passages
from studies.study import StudyContext


def test_a_plan_puts_a_walk_right() -> None:
    records = measure_passages(StudyContext(), kind=QUIET, **STUDY.fast)
    found = {(r.method, r.condition, r.metric): r.value for r in records}
    for method in (STEPS, ECHOES):
        assert found[method, MATCHED, MEDIAN] < found[method, GIVEN_START, MEDIAN]
        one, two = (found[method, MATCHED, f"within {many} sigma"] for many in ("one", "two"))
        assert 0 <= one <= two <= 1

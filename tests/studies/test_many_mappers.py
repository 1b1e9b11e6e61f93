"""Maps of many people, in small: on the plan, one map, and query walks are found in it."""

import numpy as np

from elfslam.base.values import Fixes
from elfslam.world.kinds import QUIET
from studies.located import MEDIAN_M
from studies.many_mappers import MAPPED_WAY, STUDY, _most_similar, measure_many_mappers
from studies.merging import MAP, WALKS
from studies.study import MEDIAN_ALIGNED, StudyContext


def test_both_walks_are_one_map_and_query_walks_are_found_in_it() -> None:
    records = measure_many_mappers(StudyContext(), kind=QUIET, **STUDY.fast)
    found = {(each.method, each.condition, each.metric): each.value for each in records}
    two, asked = "4 laps, 4 taps", f"4 laps, 4 taps, {MAPPED_WAY}"
    assert found[MAP, two, WALKS] == 2
    assert found[MAP, two, MEDIAN_ALIGNED] < 0.4
    assert found["ELF, track", asked, MEDIAN_M] < 0.5
    assert found["ELF, track", asked, "answered"] > 0.5
    assert found["plain spectrogram, always answered", asked, "answered"] == 1.0


def test_of_several_maps_the_most_similar_answers() -> None:
    def fixes(x_m: float, score: list[float]) -> Fixes:
        count = len(score)
        return Fixes(
            np.arange(float(count)),
            np.full((count, 2), x_m),
            np.zeros(count),
            np.tile(np.eye(2), (count, 1, 1)),
            np.array(score),
            np.zeros(count, dtype=np.int64),
        )

    best = _most_similar([fixes(1.0, [0.9, 0.2, np.nan]), fixes(2.0, [0.1, 0.8, 0.3])])
    assert best.xy_m[:, 0].tolist() == [1.0, 2.0, 2.0]
    assert best.score.tolist() == [0.9, 0.8, 0.3]

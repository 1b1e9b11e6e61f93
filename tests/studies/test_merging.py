"""The study of merging, small: pairs are drawn as they are called, and counted as they came out."""

import numpy as np
import pytest

from elfslam.base.values import Trajectory, Truth
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.world.kinds import PEOPLE
from studies.merging import (
    APART,
    CHANGED,
    FIRST,
    MAP,
    MOVED,
    OPPOSITE,
    OTHER,
    OVERLAP,
    PARTLY,
    REFUSED,
    RIGHT,
    SAME,
    SECOND,
    STUDY,
    WALKS,
    WHOLE,
    WRONG,
    Stroll,
    _drawn,
    measure_merging,
    one_after_another,
    recorded,
    truly_apart_m,
)
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, StudyContext


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    kept = tmp_path_factory.mktemp("kept") / "merging.partial"
    return measure_merging(StudyContext(kept=kept), **STUDY.fast)


def test_pairs_are_counted_by_what_they_have_in_common(records: list[Record]) -> None:
    counts = {(each.condition, each.metric): each.value for each in records}
    assert counts[OTHER, REFUSED] == 1
    assert counts[SAME, WRONG] == 0
    assert counts[OVERLAP, RIGHT] == counts[SAME, RIGHT]


def test_maps_of_two_walks_are_right(records: list[Record]) -> None:
    of = {(each.world, each.metric): each.value for each in records if each.method == MAP}
    merged = [world for (world, metric), value in of.items() if (metric, value) == (WALKS, 2.0)]
    assert merged
    assert all(of[world, MEDIAN_ALIGNED] < 0.5 for world in merged)


@pytest.mark.parametrize("common", [SAME, PARTLY, OTHER, APART, OPPOSITE, CHANGED])
def test_a_pair_is_what_it_is_called(common: str) -> None:
    generator = np.random.default_rng(3)
    for _ in range(20):
        pair = _drawn(common, ("a", "b", "c"), (0, 1, 2), generator, PEOPLE)
        assert (pair.one.world != pair.other.world) == (common == OTHER)
        assert pair.one.seed != pair.other.seed
        parts = {PARTLY: (WHOLE, FIRST), APART: (FIRST, SECOND)}.get(common, (WHOLE, WHOLE))
        assert (pair.one.part, pair.other.part) == parts
        assert pair.other.reverse == (common == OPPOSITE)
        assert pair.other.state == (MOVED if common == CHANGED else "")
        assert (pair.one.later, pair.other.later) == (False, True)
        assert pair.one.kind == pair.other.kind == PEOPLE.name


def test_two_parts_of_a_route_share_no_ground() -> None:
    truths = [recorded(Stroll("studio", 130, 2, part))[1] for part in (FIRST, SECOND)]
    one, other = (truth.world_from_body[::25, :2] for truth in truths)
    assert np.linalg.norm(one[:, None] - other[None], axis=2).min() > 0.8


def test_walks_are_compared_where_their_map_has_them_together() -> None:
    """The second walk truly began 3 m to the left, and its end lies with nothing of the first."""
    t_s = np.arange(20.0)
    poses = np.column_stack([t_s, np.zeros((20, 2))])
    none = (np.zeros((20, 3, 3)), np.empty(0), "OK")
    one, other = Trajectory(t_s, poses, *none), Trajectory(t_s, np.add(poses, [5, 0, 0]), *none)
    truths = [Truth(t_s, poses), Truth(t_s, np.add(poses, [5, 3, 0]))]
    apart_m = truly_apart_m([one, other], truths)
    assert len(apart_m) == 15
    np.testing.assert_allclose(apart_m, 3.0)
    walked, true = one_after_another([one, other], truths)
    errors_m = position_errors(walked.t_s, walked.world_from_body, true, Alignment.ALIGNED)
    assert 0.5 < np.median(errors_m) < 1.6

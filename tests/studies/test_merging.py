"""Merging and superimposition in small: pairs as they are called, spots hardly learnt."""

from pathlib import Path

import numpy as np
import pytest

from elfslam.base.values import Trajectory, Truth
from elfslam.scoring.errors import Alignment, position_errors
from elfslam.world.kinds import PEOPLE
from studies import floor_spots, merging
from studies.opposite_ways import PLACED, Ways
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, StudyContext
from studies.superimposition import measure_superimposition


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> list[Record]:
    kept = tmp_path_factory.mktemp("kept") / "merging.partial"
    return merging.measure_merging(StudyContext(kept=kept), **merging.STUDY.fast)


def test_pairs_are_counted_by_what_they_have_in_common(records: list[Record]) -> None:
    counts = {(each.condition, each.metric): each.value for each in records}
    assert counts[merging.OTHER, merging.REFUSED] == 1
    assert counts[merging.SAME, merging.WRONG] == 0
    assert counts[merging.OVERLAP, merging.RIGHT] == counts[merging.SAME, merging.RIGHT]


def test_maps_of_two_walks_are_right(records: list[Record]) -> None:
    of = {(each.world, each.metric): each.value for each in records if each.method == merging.MAP}
    merged = [world for (world, metric), n in of.items() if (metric, n) == (merging.WALKS, 2.0)]
    assert merged
    assert all(of[world, MEDIAN_ALIGNED] < 0.5 for world in merged)


@pytest.mark.parametrize(
    "common",
    [merging.SAME, merging.PARTLY, merging.OTHER, merging.APART, merging.OPPOSITE, merging.CHANGED],
)
def test_a_pair_is_what_it_is_called(common: str) -> None:
    generator = np.random.default_rng(3)
    for _ in range(20):
        pair = merging._drawn(common, ("a", "b", "c"), (0, 1, 2), generator, PEOPLE)
        assert (pair.one.world != pair.other.world) == (common == merging.OTHER)
        assert pair.one.seed != pair.other.seed
        parts = {
            merging.PARTLY: (merging.WHOLE, merging.FIRST),
            merging.APART: (merging.FIRST, merging.SECOND),
        }.get(common, (merging.WHOLE, merging.WHOLE))
        assert (pair.one.part, pair.other.part) == parts
        assert pair.other.reverse == (common == merging.OPPOSITE)
        assert pair.other.state == (merging.MOVED if common == merging.CHANGED else "")
        assert (pair.one.later, pair.other.later) == (False, True)
        assert pair.one.kind == pair.other.kind == PEOPLE.name


def test_two_parts_of_a_route_share_no_ground() -> None:
    strolls = (merging.Stroll("studio", 130, 2, at) for at in (merging.FIRST, merging.SECOND))
    truths = [merging.recorded(stroll)[1] for stroll in strolls]
    one, other = (truth.world_from_body[::25, :2] for truth in truths)
    assert np.linalg.norm(one[:, None] - other[None], axis=2).min() > 0.8


def test_walks_are_compared_where_their_map_has_them_together() -> None:
    """The second walk truly began 3 m to the left, and its end lies with nothing of the first."""
    t_s = np.arange(20.0)
    poses = np.column_stack([t_s, np.zeros((20, 2))])
    none = (np.zeros((20, 3, 3)), np.empty(0), "OK")
    one, other = Trajectory(t_s, poses, *none), Trajectory(t_s, np.add(poses, [5, 0, 0]), *none)
    truths = [Truth(t_s, poses), Truth(t_s, np.add(poses, [5, 3, 0]))]
    apart_m = merging.truly_apart_m([one, other], truths)
    assert len(apart_m) == 15
    np.testing.assert_allclose(apart_m, 3.0)
    walked, true = merging.one_after_another([one, other], truths)
    errors_m = position_errors(walked.t_s, walked.world_from_body, true, Alignment.ALIGNED)
    assert 0.5 < np.median(errors_m) < 1.6


FEW = floor_spots.Spots(spots=9, traces=16, supervised_traces=8, queries=6)
SHORT = Ways(world="studio", seed=100, rounds=1, steps=1)


def test_what_was_learnt_is_kept_and_gives_the_same_again(tmp_path: Path) -> None:
    context = StudyContext(kept=tmp_path / "kept")
    records = measure_superimposition(context, floors=[FEW], ways=[SHORT])
    asked = {(each.method, each.condition) for each in records}
    assert (floor_spots.SUPERIMPOSED, "in between, from 6") in asked
    assert {("opposite direction", placed) for placed in PLACED} <= asked
    papers = {each.paper for each in records} - {None}
    assert papers == {3.2, 0.24, 0.56, 0.34, 0.76, 0.1, 3.8}
    file = tmp_path / "superimposition" / "hall-9-16-0.onnx"
    content = file.read_bytes()
    again = measure_superimposition(StudyContext(kept=tmp_path / "other"), floors=[FEW], ways=[])
    assert file.read_bytes() == content
    assert again == [each for each in records if each.world == "hall"]


def test_spots_are_neighbours_on_the_grid() -> None:
    spots_m = floor_spots.floor_of(FEW).spots_m
    apart_m = np.linalg.norm(spots_m[:, None] - spots_m, axis=2)[np.triu_indices(9, 1)]
    assert apart_m.min() == pytest.approx(0.1)
    assert apart_m.max() < 0.5
    assert len(floor_spots.floor_of(floor_spots.Spots()).spots_m) == 4000


def test_a_fix_lies_between_the_spots_that_sound_alike() -> None:
    spots_m = np.array([[0.0, 0.0], [0.2, 0.0], [9.0, 0.0]])
    spots = np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], dtype=np.float32)
    vectors = np.repeat(np.eye(2, dtype=np.float32), floor_spots.TOGETHER, axis=0)
    np.testing.assert_allclose(floor_spots.fixes_m(vectors, spots, spots_m), [[0.1, 0], [9, 0]])
    vectors[1 : floor_spots.TOGETHER] = [0.0, 3.0]
    np.testing.assert_allclose(floor_spots.fixes_m(vectors, spots, spots_m)[0], [9, 0])

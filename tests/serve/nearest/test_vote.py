"""The vote of footsteps for a map: planted answers, abstention, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from elfslam.base.arrays import F32, I64
from elfslam.base.errors import InputError
from elfslam.base.values import FixStatus
from elfslam.serve.nearest import VoteParameters, which_map

KNOWN = VoteParameters(least=0.05, lead=0.03, candidates=3)


def tens(ids: I64) -> I64:
    return ids // 10


def like(rows: list[list[float]]) -> F32:
    return np.array(rows, dtype=np.float32)


def test_the_map_that_stands_out_is_named() -> None:
    ids = np.array([[31, 32, 50, 70], [52, 39, 33, 71]])
    similarity = like([[0.9, 0.89, 0.7, 0.6], [0.8, 0.79, 0.7, 0.5]])
    naming = which_map(ids, similarity, tens, KNOWN)
    assert naming.status is FixStatus.OK
    assert [each.number for each in naming.candidates] == [3, 5]
    np.testing.assert_allclose([each.score for each in naming.candidates], [0.295, 0.2], atol=1e-6)
    assert [each.footsteps for each in naming.candidates] == [2, 2]


def test_more_footsteps_need_less_of_a_lead() -> None:
    ids, similarity = np.array([[31, 41, 70]]), like([[0.9, 0.88, 0.6]])
    once = which_map(ids, similarity, tens, KNOWN)
    often = which_map(ids.repeat(4, 0), similarity.repeat(4, 0), tens, KNOWN)
    assert once.status is FixStatus.AMBIGUOUS
    assert often.status is FixStatus.OK


def test_many_spots_of_a_map_do_not_outvote_its_best() -> None:
    ids = np.array([[50, 31, 32, 33, 70]])
    naming = which_map(ids, like([[0.9, 0.8, 0.8, 0.8, 0.6]]), tens, KNOWN)
    assert naming.candidates[0].number == 5


def test_maps_that_are_alike_are_ambiguous_and_a_coarser_vote_is_not() -> None:
    ids, similarity = np.array([[31, 41, 70], [42, 32, 71]]), like([[0.9, 0.88, 0.6]] * 2)
    assert which_map(ids, similarity, tens, KNOWN).status is FixStatus.AMBIGUOUS
    paired = which_map(ids, similarity, lambda x: np.where(x < 50, 0, 1), KNOWN)
    assert paired.status is FixStatus.OK
    assert paired.candidates[0].number == 0


def test_where_nothing_stands_out_the_place_is_unknown() -> None:
    ids = np.array([[31, 41, 70], [82, 52, 71]])
    naming = which_map(ids, like([[0.63, 0.62, 0.6]] * 2), tens, KNOWN)
    assert naming.status is FixStatus.UNKNOWN_PLACE
    assert naming.candidates


@pytest.mark.parametrize(
    ("footsteps", "status"), [(0, FixStatus.NO_ECHO), (3, FixStatus.UNKNOWN_PLACE)]
)
def test_without_neighbours_there_is_no_candidate(footsteps: int, status: FixStatus) -> None:
    ids = np.full((footsteps, 5), -1)
    naming = which_map(ids, np.full(ids.shape, -1, np.float32), tens, KNOWN)
    assert naming.status is status
    assert naming.candidates == ()


def test_absent_neighbours_do_not_lower_the_floor() -> None:
    ids, similarity = np.array([[31, 41, -1]]), like([[0.9, 0.8, -1.0]])
    naming = which_map(ids, similarity, tens, KNOWN)
    assert [each.number for each in naming.candidates] == [3]
    assert naming.candidates[0].score == pytest.approx(0.1)


def test_one_neighbour_is_refused() -> None:
    with pytest.raises(InputError, match="2 or more"):
        which_map(np.zeros((4, 1), int), np.zeros((4, 1), np.float32), tens)


@given(st.integers(0, 2**31), st.integers(1, 6))
def test_the_order_of_footsteps_does_not_matter(seed: int, footsteps: int) -> None:
    generator = np.random.default_rng(seed)
    ids = generator.integers(0, 60, (footsteps, 5))
    similarity = np.sort(generator.uniform(0, 1, (footsteps, 5)).astype("f4"), axis=1)[:, ::-1]
    turned = which_map(ids[::-1], similarity[::-1], tens, KNOWN)
    straight = which_map(ids, similarity, tens, KNOWN)
    assert turned.status is straight.status
    np.testing.assert_allclose(
        [each.score for each in turned.candidates],
        [each.score for each in straight.candidates],
        atol=1e-9,
    )

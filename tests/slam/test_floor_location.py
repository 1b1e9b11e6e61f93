"""Which floor: votes over a whole walk where a barometer tells floors apart, else around a time."""

import numpy as np
import numpy.testing as npt

from elfslam.slam.floor_location import floors_by_vote
from elfslam.stages.levels import LevelParameters

KNOWN = LevelParameters(vote_s=20.0, least_lead=0.05)
T_S = np.arange(100.0)


def test_with_relative_levels_all_vote_on_the_first() -> None:
    relative = np.concatenate([np.zeros(40), np.full(10, np.nan), np.ones(50)])
    scores = np.tile([0.7, 0.7, 0.7], (100, 1))
    scores[relative == 0, 1] += 0.1
    scores[relative == 1, 2] += 0.1
    level, sure = floors_by_vote(T_S, scores, [0, 1, 2], relative, KNOWN)
    npt.assert_array_equal(level, relative + 1)
    assert sure.all()


def test_a_floor_that_no_map_has_is_held_against_a_shift() -> None:
    relative = np.concatenate([np.zeros(50), np.ones(50)])
    scores = np.tile([0.9, 0.6], (100, 1))
    scores[50:] = [0.6, 0.9]
    level, sure = floors_by_vote(T_S, scores, [0, 1], relative, KNOWN)
    npt.assert_array_equal(level, relative)
    assert sure.all()


def test_floors_that_sound_alike_are_not_told_apart() -> None:
    scores = np.tile([0.7, 0.69], (100, 1))
    for relative in (np.zeros(100), None):
        level, sure = floors_by_vote(T_S, scores, [0, 1], relative, KNOWN)
        npt.assert_array_equal(level, 0)
        assert not sure.any()


def test_without_a_barometer_each_moment_is_voted_on_by_those_around_it() -> None:
    scores = np.tile([0.9, 0.6], (100, 1))
    scores[50:] = scores[50:, ::-1]
    scores[20] = [0.0, 1.0]
    scores[70] = np.nan
    level, sure = floors_by_vote(T_S, scores, [0, 3], None, KNOWN)
    npt.assert_array_equal(level[:45], 0)
    npt.assert_array_equal(level[55:], 3)
    assert sure[60:].all()


def test_one_floor_needs_no_vote() -> None:
    level, sure = floors_by_vote(T_S, np.full((100, 1), 0.5), [2], np.zeros(100), KNOWN)
    npt.assert_array_equal(level, 2)
    assert sure.all()

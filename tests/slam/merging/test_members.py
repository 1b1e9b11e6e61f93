"""Walks and maps as merging sees them."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.errors import InputError
from elfslam.base.values import MeanSimilarity, Run
from elfslam.slam.merging import MergeParameters, walk_of
from elfslam.slam.merging.forgetting import stacked
from elfslam.slam.merging.grow import map_of
from elfslam.slam.merging.members import (
    links_between,
    meeting_of,
    placed,
    side_of,
    sides_of,
    usual_of,
)

KNOWN = MergeParameters()


def test_a_map_is_walked_again_in_even_steps(walker: Callable, here: Callable) -> None:
    walks = [walker(here, str(k), seed=k) for k in range(2)]
    floor_map = stacked(*(map_of(walk, walk.trajectory, KNOWN) for walk in walks))
    one, other = sides_of(floor_map, KNOWN)
    steps_m = np.linalg.norm(np.diff(one.poses[:, :2], axis=0), axis=1)
    npt.assert_allclose(np.median(steps_m), KNOWN.merging.spacing_m, atol=0.1)
    assert len(one.poses) == pytest.approx(len(walks[0].odometry.t_s), rel=0.15)
    assert not np.array_equal(one.poses, other.poses)
    assert len(links_between(one, side_of(walks[1], KNOWN), KNOWN).i) > 20


def test_a_walk_resembles_itself_as_it_does_in_its_map(walker: Callable, here: Callable) -> None:
    walk = walker(here, "a")
    (again,) = sides_of(map_of(walk, walk.trajectory, KNOWN), KNOWN)
    side = side_of(walk, KNOWN)
    assert side.usual == pytest.approx(again.usual, rel=0.15)
    assert side.sigma_m == pytest.approx(0.1)
    assert usual_of([side, replace(side, usual=4 * side.usual)]) == pytest.approx(2 * side.usual)


def test_a_meeting_counts_the_footsteps_of_all_walks_through(
    walker: Callable, here: Callable
) -> None:
    sides = [side_of(walker(here, str(k), seed=k), KNOWN) for k in range(3)]
    links = [links_between(one, sides[2], KNOWN) for one in sides[:2]]
    meeting = meeting_of(sides[:2], sides[2], links, KNOWN)
    count = len(sides[0].poses)
    npt.assert_array_equal(meeting.links.i[len(links[0].i) :], links[1].i + count)
    assert meeting.scores.shape == (2 * count, count)
    npt.assert_array_equal(placed(sides[0], np.zeros(3)).poses[:, :2], sides[0].poses[:, :2])


def test_only_walks_with_sound_are_merged(walker: Callable, here: Callable) -> None:
    walk = walker(here, "silent")
    silent = MeanSimilarity(np.zeros((1, 1)), "motion")
    known = (walk.odometry, silent, walk.closures, walk.trajectory)
    with pytest.raises(InputError, match="silent: was mapped without sound"):
        walk_of(Run("silent", *known, None, None, None))
    assert walk_of(Run("loud", *known, None, None, walk.features)).name == "loud"

"""What newer walks pass fades; what they no longer know is marked."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.values import FloorMap
from elfslam.slam.merging import MergeParameters
from elfslam.slam.merging.forgetting import chosen_spots, renewed, stacked
from elfslam.slam.merging.grow import map_of
from elfslam.slam.merging.members import MergingParameters

KNOWN = MergeParameters()
FADE = KNOWN.merging.fade


@pytest.fixture
def made(walker: Callable) -> Callable[..., FloorMap]:
    """The map of one walk over a place, in the frame of the place."""

    def walked(heard: Callable, seed: int) -> FloorMap:
        walk = walker(heard, str(seed), seed=seed)
        return map_of(walk, walk.trajectory, KNOWN)

    return walked


def test_what_is_passed_again_fades_and_what_is_not_stays(made: Callable, here: Callable) -> None:
    old, new = made(here, 1), made(here, 2)
    left = new.xy_m[:, 0] < 4
    grown = renewed(old, chosen_spots(new, left), KNOWN)
    npt.assert_array_equal(grown.weight[: len(old.xy_m)][old.xy_m[:, 0] < 3], FADE)
    npt.assert_array_equal(grown.weight[: len(old.xy_m)][old.xy_m[:, 0] > 5], 1.0)
    npt.assert_array_equal(grown.weight[len(old.xy_m) :], 1.0)
    assert not grown.changed.any()


def test_what_faded_away_leaves_the_map(made: Callable, here: Callable) -> None:
    known = replace(KNOWN, merging=MergingParameters(fade=0.05))
    old, new = made(here, 1), made(here, 2)
    grown = renewed(old, new, known)
    assert (grown.walk == 0).mean() < 0.05
    assert grown.sources == ("1", "2")


def changing(here: Callable, elsewhere: Callable) -> Callable:
    """The place, another one where y is above 4 m."""

    def heard(poses: np.ndarray) -> np.ndarray:
        return np.where(poses[:, 1:2] > 4, elsewhere(poses), here(poses))

    return heard


def test_a_changed_corner_is_marked_and_fades_faster(
    made: Callable, here: Callable, elsewhere: Callable
) -> None:
    old, new = made(here, 1), made(changing(here, elsewhere), 2)
    grown = renewed(old, new, KNOWN)
    before = slice(0, len(old.xy_m))
    changed, y_m = grown.changed[before], old.xy_m[:, 1]
    assert changed[y_m > 5].mean() > 0.9
    assert not changed[y_m < 3].any()
    npt.assert_array_equal(grown.weight[before][changed], KNOWN.merging.fade_changed)
    assert not grown.changed[len(old.xy_m) :].any()


def test_one_pass_changes_nothing(made: Callable, here: Callable, elsewhere: Callable) -> None:
    old, new = made(here, 1), made(changing(here, elsewhere), 2)
    once = chosen_spots(new, new.order < 200)
    assert not renewed(old, once, KNOWN).changed.any()


def test_maps_are_stacked_walk_by_walk(made: Callable, here: Callable) -> None:
    one, other = made(here, 1), made(here, 2)
    both = stacked(stacked(one, other), one)
    npt.assert_array_equal(np.unique(both.walk), [0, 1, 2])
    npt.assert_array_equal(both.xy_m[both.walk == 1], other.xy_m)
    npt.assert_array_equal(both.payloads[0].vectors[both.walk == 2], one.payloads[0].vectors)
    assert both.sources == ("1", "2", "1")

"""Short walks are found by their shape and by what they sound like."""

import dataclasses

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.geometry import compose
from elfslam.base.values import Fixes, FixStatus, FloorMap, Odometry
from elfslam.stages.segments import SegmentParameters, locate_by_segments, paths_of, shape_errors
from tests.stages.planted_spots import STEP_M, heard, made_map

PARAMETERS = SegmentParameters()
OFF = compose(np.array([4.0, -3.0, 2.0]), np.zeros(3))
"""Dead reckoning starts anywhere."""


def loop(spacing_m: float) -> F64:
    """Poses once round a room of 8 m by 5 m."""
    corners = np.array([[0.0, 0.0], [8.0, 0.0], [8.0, 5.0], [0.0, 5.0], [0.0, 0.0]])
    at_m = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    places_m = np.arange(0.0, at_m[-1], spacing_m)
    xy_m = np.column_stack([np.interp(places_m, at_m, column) for column in corners.T])
    side = np.searchsorted(at_m, places_m, side="right") - 1
    return np.column_stack([xy_m, np.array([0.0, np.pi / 2, np.pi, -np.pi / 2])[side]])


def walked(poses: F64, scale: float = 1.0) -> Odometry:
    """The same poses as dead reckoning has them: somewhere else, with longer or shorter steps."""
    reckoned = compose(OFF, poses * np.array([scale, scale, 1.0]))
    return Odometry(0.5 * np.arange(len(poses)), reckoned, np.full((len(poses) - 1, 3), 0.1))


def middles(poses: F64) -> F64:
    return np.asarray((poses[1:, :2] + poses[:-1, :2]) / 2)[PARAMETERS.footsteps - 1 :]


def located(poses: F64, floor_map: FloorMap, scale: float = 1.0) -> Fixes:
    return locate_by_segments(walked(poses, scale), heard(poses, floor_map), floor_map, PARAMETERS)


@pytest.mark.parametrize("scale", [1.0, 0.9, 1.1])
def test_a_walk_is_found_wherever_it_starts_and_however_long_its_steps(scale: float) -> None:
    floor_map, poses = made_map(loop(0.14)), loop(STEP_M)
    fixes = located(poses, floor_map, scale)
    npt.assert_array_equal(fixes.status, FixStatus.OK)
    npt.assert_allclose(np.linalg.norm(fixes.xy_m - middles(poses), axis=1), 0.0, atol=0.3)
    assert len(fixes.t_s) == len(poses) - PARAMETERS.footsteps


@pytest.mark.parametrize("by_m", [[1e3, 1e3], [5e5, 5e6]], ids=["1 km", "UTM"])
def test_moving_the_map_moves_the_fixes_and_leaves_every_covariance(by_m: list[float]) -> None:
    floor_map, poses = made_map(loop(0.14)), loop(STEP_M)
    far = dataclasses.replace(floor_map, xy_m=floor_map.xy_m + by_m)
    nodes, scores = walked(poses), heard(poses, floor_map)
    here, there = (locate_by_segments(nodes, scores, each, PARAMETERS) for each in (floor_map, far))
    npt.assert_allclose(there.xy_m - by_m, here.xy_m, atol=1e-6)
    npt.assert_allclose(there.covariance_m2, here.covariance_m2, atol=1e-6)


def test_a_walk_the_other_way_is_found_too_and_told_from_the_mapped_way() -> None:
    floor_map, back = made_map(loop(0.14)), loop(STEP_M)[::-1]
    back = np.column_stack([back[:, :2], back[:, 2] + np.pi])
    fixes = located(back, floor_map)
    npt.assert_allclose(np.linalg.norm(fixes.xy_m - middles(back), axis=1), 0.0, atol=0.3)
    turned = np.exp(1j * (fixes.heading_rad - back[PARAMETERS.footsteps :, 2]))
    assert np.median(turned.real) > 0.9


def test_the_shape_rules_out_what_sounds_the_same() -> None:
    """Every place sounds alike: only stretches around a corner fit a walk round a corner."""
    floor_map = made_map(loop(0.14))
    poses = loop(STEP_M)[6:18]
    same = np.full((len(poses) - 1, len(floor_map.xy_m)), 0.9, dtype=np.float32)
    fixes = locate_by_segments(walked(poses), same, floor_map, PARAMETERS)
    assert set(fixes.status) == {FixStatus.AMBIGUOUS}
    straight = made_map(loop(0.14)[:57])
    lost = locate_by_segments(walked(poses), same[:, :57], straight, PARAMETERS)
    assert FixStatus.UNKNOWN_PLACE in set(lost.status)


def test_what_sounds_like_nowhere_is_an_unknown_place() -> None:
    floor_map, poses = made_map(loop(0.14)), loop(STEP_M)
    quiet = 0.4 * heard(poses, floor_map)
    fixes = locate_by_segments(walked(poses), quiet, floor_map, PARAMETERS)
    assert set(fixes.status) == {FixStatus.UNKNOWN_PLACE}
    assert np.isnan(fixes.xy_m).all()


def test_silence_is_said_and_a_few_silent_footsteps_do_no_harm() -> None:
    floor_map, poses = made_map(loop(0.14)), loop(STEP_M)
    scores = heard(poses, floor_map)
    scores[10:12] = np.nan
    whole = locate_by_segments(walked(poses), scores, floor_map, PARAMETERS)
    npt.assert_array_equal(whole.status, FixStatus.OK)
    scores[10:20] = np.nan
    gap = locate_by_segments(walked(poses), scores, floor_map, PARAMETERS)
    assert FixStatus.NO_ECHO in set(gap.status)
    assert gap.status[0] == FixStatus.OK


def test_too_short_a_walk_gives_no_fix() -> None:
    floor_map, poses = made_map(loop(0.14)), loop(STEP_M)[:8]
    assert len(located(poses, floor_map).t_s) == 0


def test_a_mapped_walk_is_cut_where_it_jumps() -> None:
    poses = loop(0.14)
    poses[90:, 0] += 30.0
    paths = paths_of(made_map(poses))
    steps_m = np.linalg.norm(np.diff(paths.xy_m, axis=0), axis=1)
    same = paths.first[1:] == paths.first[:-1]
    assert len(np.unique(paths.first)) == 4
    assert steps_m[same].max() < 0.2


def test_shapes_do_not_change_by_moving_them() -> None:
    curve = np.random.default_rng(0).normal(size=(8, 2)).cumsum(axis=0)
    moved = compose(OFF, np.column_stack([curve, np.zeros(8)]))[:, :2]
    path, places = np.concatenate([curve, moved]), np.arange(8)
    npt.assert_allclose(shape_errors(path, places, curve)[[0, 8]], 0.0, atol=1e-6)
    mirrored = curve * np.array([1.0, -1.0])
    assert shape_errors(mirrored, places, curve)[0] > 0.1


def test_the_error_of_a_stretch_is_that_of_the_best_rigid_fit() -> None:
    generator = np.random.default_rng(1)
    path = generator.normal(size=(60, 2)).cumsum(axis=0) + 100.0
    curve, places = generator.normal(size=(5, 2)).cumsum(axis=0), np.array([0, 2, 3, 7, 9])
    errors = shape_errors(path, places, curve)
    assert len(errors) == 51
    ours = (curve - curve.mean(axis=0)) @ [1, 1j]
    turns = np.exp(1j * np.linspace(-np.pi, np.pi, 20_000))[:, None]
    for k in (0, 17, 50):
        theirs = (path[k + places] - path[k + places].mean(axis=0)) @ [1, 1j]
        tried = np.sqrt(np.mean(np.abs(theirs - turns * ours) ** 2, axis=1))
        assert errors[k] == pytest.approx(tried.min(), abs=1e-4)
    assert len(shape_errors(path[:9], places, curve)) == 0


def test_more_footsteps_can_be_asked_for() -> None:
    floor_map, poses = made_map(loop(0.14)), loop(STEP_M)
    longer = dataclasses.replace(PARAMETERS, footsteps=12)
    fixes = locate_by_segments(walked(poses), heard(poses, floor_map), floor_map, longer)
    assert len(fixes.t_s) == len(poses) - 12

"""The tracker starts anywhere, recovers, and says when it does not know."""

import time
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.geometry import compose
from elfslam.base.values import Fixes, FixStatus, FloorMap, Odometry
from elfslam.stages.track import Cloud, Tracker, TrackParameters, densest
from tests.stages.planted_spots import STEP_M, heard, made_map

PARAMETERS = TrackParameters()
OFF = np.array([4.0, -3.0, 2.0])
"""Dead reckoning starts anywhere, and heads anywhere."""


def corridor(length_m: float, spacing_m: float) -> F64:
    """Poses along a corridor with a corner halfway."""
    places_m = np.arange(0.0, length_m, spacing_m)
    half = length_m / 2
    xy_m = np.column_stack([np.minimum(places_m, half), np.maximum(places_m - half, 0.0)])
    return np.column_stack([xy_m, np.where(places_m < half, 0.0, np.pi / 2)])


def walked(poses: F64, scale: float = 1.0) -> Odometry:
    reckoned = compose(OFF, poses * np.array([scale, scale, 1.0]))
    sigma = np.tile([0.15, 0.1, 0.01], (len(poses) - 1, 1))
    return Odometry(0.5 * np.arange(len(poses)), reckoned, sigma)


def tracker(floor_map: FloorMap, seed: int = 0) -> Tracker:
    return Tracker(floor_map, PARAMETERS, np.random.default_rng(seed))


def errors_m(fixes: Fixes, poses: F64) -> F64:
    return np.asarray(np.linalg.norm(fixes.xy_m - poses[1:, :2], axis=1))


FLOOR = made_map(corridor(24.0, 0.14))
POSES = corridor(24.0, STEP_M)


@pytest.mark.parametrize("scale", [1.0, 0.93, 1.07])
def test_it_starts_anywhere_whatever_the_heading_and_the_length_of_steps(scale: float) -> None:
    fixes = tracker(FLOOR).follow(walked(POSES, scale), heard(POSES, FLOOR))
    npt.assert_array_equal(fixes.status, FixStatus.OK)
    assert errors_m(fixes, POSES).max() < 0.5
    assert np.median(errors_m(fixes, POSES)) < 0.2
    turned = fixes.heading_rad[5:] - POSES[6:, 2]
    assert np.median(np.abs(turned)) < 0.15
    npt.assert_allclose(fixes.t_s, 0.5 * np.arange(1, len(POSES)))


@pytest.mark.parametrize("by_m", [[1e3, 1e3], [5e5, 5e6]], ids=["1 km", "UTM"])
def test_moving_the_map_moves_the_fixes_and_leaves_every_covariance(by_m: list[float]) -> None:
    far = replace(FLOOR, xy_m=FLOOR.xy_m + by_m)
    nodes, scores = walked(POSES), heard(POSES, FLOOR)
    here, there = (tracker(each).follow(nodes, scores) for each in (FLOOR, far))
    npt.assert_array_equal(there.status, here.status)
    npt.assert_allclose(there.xy_m - here.xy_m, np.tile(by_m, (len(here.t_s), 1)), atol=1e-6)
    npt.assert_allclose(there.covariance_m2, here.covariance_m2, atol=1e-6)


def test_the_covariance_is_that_of_the_particles_and_the_map_and_a_floor() -> None:
    def covariance_m2(floor_map: FloorMap, floor_m: float, reach_m: float = 1.0) -> F64:
        known = replace(PARAMETERS, sigma_floor_m=floor_m)
        follower = Tracker(floor_map, known, np.random.default_rng(0))
        return follower.follow(walked(POSES), heard(POSES, FLOOR, reach_m)).covariance_m2

    sharp_m2, rough = covariance_m2(FLOOR, 0.1), 6 * FLOOR.covariance_m2
    rougher_m2 = covariance_m2(replace(FLOOR, covariance_m2=rough), 0.1)
    npt.assert_allclose(rougher_m2 - sharp_m2, np.tile(0.05 * np.eye(2), (len(sharp_m2), 1, 1)))
    floored_m2 = covariance_m2(FLOOR, 0.5)
    npt.assert_allclose(floored_m2 - sharp_m2, np.tile(0.24 * np.eye(2), (len(sharp_m2), 1, 1)))
    particles_m2 = [spread_m2(covariance_m2(FLOOR, 0.1, reach_m)) for reach_m in (0.5, 1.0, 2.0)]
    assert 0.001 < particles_m2[0] < particles_m2[1] < particles_m2[2] < 0.25


def spread_m2(covariance_m2: F64) -> float:
    """Of the particles, without the map's share and the floor of 0.1 m."""
    return float(np.mean(np.trace(covariance_m2[5:] - 0.02 * np.eye(2), axis1=1, axis2=2)))


def test_the_same_generator_gives_the_same_fixes_and_chunks_give_the_whole() -> None:
    nodes, scores = walked(POSES), heard(POSES, FLOOR)
    whole = tracker(FLOOR).follow(nodes, scores)
    live = tracker(FLOOR)
    parts = []
    for a, b in ((0, 1), (1, 9), (9, len(scores))):
        poses, sigma = nodes.world_from_body[a : b + 1], nodes.step_sigma[a:b]
        parts.append(live.follow(Odometry(nodes.t_s[a : b + 1], poses, sigma), scores[a:b]))
    for field in ("t_s", "xy_m", "covariance_m2", "score", "status"):
        joined = np.concatenate([getattr(part, field) for part in parts])
        npt.assert_array_equal(joined, getattr(whole, field))
    other = tracker(FLOOR, seed=1).follow(nodes, scores)
    assert not np.array_equal(other.xy_m, whole.xy_m)


def test_a_kidnapped_phone_is_found_again() -> None:
    """The second half of the walk goes on 8 m back; dead reckoning knows nothing of it."""
    here = np.vstack([POSES[:15], POSES[3:15]])
    scores = np.vstack([heard(POSES[:15], FLOOR), heard(POSES[2:15], FLOOR)[:12]])
    nodes = walked(POSES[: len(here)])
    credulous = Tracker(FLOOR, replace(PARAMETERS, jump=3.0), np.random.default_rng(0))
    fixes = credulous.follow(nodes, scores[: len(here) - 1])
    assert errors_m(fixes, here)[:13].max() < 0.5
    assert errors_m(fixes, here)[-4:].max() < 0.5
    npt.assert_array_equal(fixes.status[-4:], FixStatus.OK)


def test_echoes_of_where_no_step_leads_are_suspect_and_move_nothing() -> None:
    scores = heard(POSES, FLOOR)
    scores[18:26] = heard(POSES[2:11], FLOOR)
    fixes = tracker(FLOOR).follow(walked(POSES), scores)
    npt.assert_array_equal(fixes.status[:18], FixStatus.OK)
    npt.assert_array_equal(fixes.status[18:26], FixStatus.SUSPECT)
    assert errors_m(fixes, POSES)[18:26].max() < 1.0
    spread = np.trace(fixes.covariance_m2, axis1=1, axis2=2)
    assert (np.diff(spread[18:26]) > 0).all()
    npt.assert_array_equal(fixes.status[-6:], FixStatus.OK)
    assert errors_m(fixes, POSES)[-4:].max() < 0.5


def test_a_walker_who_is_not_settled_yet_may_jump() -> None:
    scores = heard(POSES, FLOOR)
    scores[:3] = heard(POSES[20:24], FLOOR)
    fixes = tracker(FLOOR).follow(walked(POSES), scores)
    assert FixStatus.SUSPECT not in fixes.status
    assert errors_m(fixes, POSES)[-4:].max() < 0.5


def test_what_others_suspect_moves_nothing_either() -> None:
    scores, suspect = heard(POSES, FLOOR), np.zeros(len(POSES) - 1, np.bool_)
    scores[20:26], suspect[20:26] = heard(POSES[2:9], FLOOR), True
    fixes = tracker(FLOOR).follow(walked(POSES), scores, suspect)
    npt.assert_array_equal(fixes.status == FixStatus.SUSPECT, suspect)
    assert errors_m(fixes, POSES)[20:26].max() < 1.0
    spread = np.trace(fixes.covariance_m2, axis1=1, axis2=2)
    assert spread[25] > 1.5 * spread[19]
    from_the_start = tracker(FLOOR).follow(walked(POSES), scores, np.ones_like(suspect))
    assert set(from_the_start.status) == {FixStatus.SUSPECT}
    assert np.isnan(from_the_start.xy_m).all()


def test_a_freak_echo_from_elsewhere_does_not_move_it() -> None:
    scores = heard(POSES, FLOOR)
    scores[20] = np.maximum(heard(POSES[2:4], FLOOR)[0], 0.4)
    fixes = tracker(FLOOR).follow(walked(POSES), scores)
    settled = errors_m(fixes, POSES)
    assert settled[20] < 0.7
    assert settled[21:].max() < 0.5


def test_two_equal_corridors_are_ambiguous_until_something_differs() -> None:
    apart = np.array([0.0, 30.0, 0.0])
    both = made_map(np.vstack([corridor(24.0, 0.14), corridor(24.0, 0.14) + apart]))
    count = len(FLOOR.xy_m)
    scores = np.hstack([heard(POSES, FLOOR), heard(POSES, FLOOR)])
    scores[24:, :count] *= 0.6
    fixes = tracker(both).follow(walked(POSES), scores)
    npt.assert_array_equal(fixes.status[:24], FixStatus.AMBIGUOUS)
    npt.assert_array_equal(fixes.status[27:], FixStatus.OK)
    assert errors_m(fixes, POSES + apart)[27:].max() < 0.5


def test_another_place_is_unknown_and_the_way_back_is_found() -> None:
    scores = heard(POSES, FLOOR)
    scores[10:22] = 0.25 + 0.1 * np.random.default_rng(0).uniform(size=scores[10:22].shape)
    fixes = tracker(FLOOR).follow(walked(POSES), scores.astype(np.float32))
    npt.assert_array_equal(fixes.status[:10], FixStatus.OK)
    npt.assert_array_equal(fixes.status[14:22], FixStatus.UNKNOWN_PLACE)
    assert np.isnan(fixes.xy_m[14:22]).all()
    npt.assert_array_equal(fixes.status[-5:], FixStatus.OK)
    assert errors_m(fixes, POSES)[-5:].max() < 0.5
    lost = tracker(FLOOR).follow(walked(POSES), np.full_like(scores, 0.3))
    assert set(lost.status) == {FixStatus.UNKNOWN_PLACE}


def test_silence_goes_on_by_dead_reckoning_and_is_less_sure() -> None:
    scores = heard(POSES, FLOOR)
    scores[20:26] = np.nan
    fixes = tracker(FLOOR).follow(walked(POSES), scores)
    npt.assert_array_equal(fixes.status[20:26], FixStatus.NO_ECHO)
    assert errors_m(fixes, POSES)[20:26].max() < 1.0
    spread = np.trace(fixes.covariance_m2, axis1=1, axis2=2)
    assert spread[25] > 1.5 * spread[19]
    silent = tracker(FLOOR).follow(walked(POSES), np.full_like(scores, np.nan))
    assert set(silent.status) == {FixStatus.NO_ECHO}
    assert np.isnan(silent.xy_m).all()


def test_in_silence_each_step_adds_the_error_that_it_was_reckoned_with() -> None:
    """Ten steps in place say nothing but noise: variances add up along each axis."""
    known = replace(PARAMETERS, scale_sigma=0.0, turn_sigma_rad=0.0, near_m=50.0)
    follower = Tracker(FLOOR, known, np.random.default_rng(0))
    here, scores = POSES[:8], heard(POSES[:8], FLOOR)
    before_m2 = follower.follow(walked(here), scores).covariance_m2[-1]
    here, sigma = np.tile(OFF, (11, 1)), np.tile([0.3, 0.1, 1e-9], (10, 1))
    still = Odometry(10.0 + np.arange(11), here, sigma)
    silence = np.full((10, scores.shape[1]), np.nan, np.float32)
    after_m2 = follower.follow(still, silence).covariance_m2[-1]
    npt.assert_allclose(np.trace(after_m2 - before_m2), 10 * (0.3**2 + 0.1**2), rtol=0.15)


def test_the_densest_place_is_that_of_most_weight_not_of_most_particles() -> None:
    generator = np.random.default_rng(0)
    xy_m = np.vstack([generator.normal(0, 0.1, (90, 2)), generator.normal(5.5, 0.1, (10, 2))])
    weight = np.concatenate([np.full(90, 0.004), np.full(10, 0.064)])
    cloud = Cloud(np.column_stack([xy_m, np.zeros(100)]), np.ones(100), weight)
    npt.assert_allclose(densest(cloud, 1.0), 5.5, atol=0.1)


def test_a_footstep_is_quick_in_a_map_of_4000_spots() -> None:
    large = made_map(corridor(560.0, 0.14))
    scores = heard(POSES, large)
    live = tracker(large)
    live.follow(walked(POSES[:4]), scores[:3])
    moves = np.tile([STEP_M, 0.0, 0.0], (len(scores), 1))
    start_s = time.process_time()
    for move, row in zip(moves, scores, strict=True):
        live.step(move, np.array([0.15, 0.1, 0.01]), row)
    assert (time.process_time() - start_s) / len(scores) < 0.05

"""One graph over several walks: bent walks come to lie on each other."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.geometry import between, chain, compose, shifted
from elfslam.base.values import Checkpoints
from elfslam.slam.merging import MappedWalk, MergeParameters
from elfslam.slam.merging.joint_graph import against_map, joined_walks
from elfslam.slam.merging.members import links_between, middles, side_of

KNOWN = MergeParameters()
FAR_M = np.array([[1e3, 1e3], [5e5, 5e6]])


def second_order_inflated(walk: MappedWalk, drift_rad: float) -> MappedWalk:
    """The walk as dead reckoning with a steady turn has it."""
    poses = walk.trajectory.world_from_body
    moves = between(poses[:-1], poses[1:])
    moves[:, 2] += drift_rad
    wrong = chain(poses[0], moves)
    sigma = np.tile([0.1, 0.1, 0.03], (len(moves), 1))
    odometry = replace(walk.odometry, world_from_body=wrong, step_sigma=sigma)
    trajectory = replace(walk.trajectory, world_from_body=wrong)
    return replace(walk, odometry=odometry, trajectory=trajectory)


def off_m(poses: F64, wanted: F64) -> float:
    return float(np.median(np.linalg.norm(poses[:, :2] - wanted[:, :2], axis=1)))


def test_a_bent_walk_is_straightened_by_a_straight_one(walker: Callable, here: Callable) -> None:
    one = walker(here, "one", seed=1)
    other = second_order_inflated(walker(here, "other", seed=2), 0.01)
    wanted = walker(here, "other", seed=2).trajectory.world_from_body
    links = {(0, 1): links_between(side_of(one, KNOWN), side_of(other, KNOWN), KNOWN)}
    assert off_m(other.trajectory.world_from_body, wanted) > 0.5
    first, second = joined_walks([one, other], [np.zeros(3)] * 2, links, KNOWN)
    assert off_m(second.world_from_body, first.world_from_body) < 0.35
    npt.assert_allclose(first.world_from_body[0], one.trajectory.world_from_body[0], atol=1e-3)
    assert first.covariance[0, 0, 0] < second.covariance[-1, 0, 0]


def test_links_that_no_pose_bears_out_do_no_harm(walker: Callable, here: Callable) -> None:
    walks = [walker(here, str(k), seed=k) for k in range(2)]
    links = links_between(*(side_of(walk, KNOWN) for walk in walks), KNOWN)
    wrong = np.arange(len(links.i)) % 3 == 0
    count = len(walks[0].odometry.t_s[1:])
    spoilt = replace(links, i=np.where(wrong, (links.i + 21) % count, links.i))
    starts, pair = [np.zeros(3)] * 2, (0, 1)
    clean, dirty = (joined_walks(walks, starts, {pair: by}, KNOWN)[1] for by in (links, spoilt))
    assert off_m(dirty.world_from_body, clean.world_from_body) < 0.1


def test_known_starts_hold_walks_that_share_no_ground(walker: Callable, here: Callable) -> None:
    walks = [walker(here, str(k), start=[20.0 * k, 0.0, 0.0]) for k in range(2)]
    far = links_between(*(side_of(walk, KNOWN) for walk in walks), KNOWN)
    _, second = joined_walks(walks, [np.zeros(3)] * 2, {(0, 1): far}, KNOWN, known_starts=True)
    wanted = walks[1].trajectory.world_from_body
    npt.assert_allclose(between(wanted, second.world_from_body), 0, atol=0.05)
    assert second.covariance[0, 0, 0] > 0.5 * KNOWN.merging.start_sigma_m**2


def tapped(walk: MappedWalk, footsteps: list[int]) -> MappedWalk:
    """The walk, whose walker tapped on a plan at some of its footsteps."""
    named = tuple(map(str, footsteps))
    xy_m = walk.trajectory.world_from_body[footsteps, :2]
    return replace(walk, checkpoints=Checkpoints(walk.odometry.t_s[footsteps], named, xy_m))


def test_taps_hold_a_walk_better_than_a_declared_start(walker: Callable, here: Callable) -> None:
    """Bent walks that share no ground: no link between them says anything."""
    true = [walker(here, str(k), start=[20.0 * k, 0.0, 0.0]) for k in range(2)]
    told = [tapped(walk, [2, 15, 30, 45]) for walk in true]
    wrong = [
        replace(
            second_order_inflated(walk, 0.01),
            checkpoints=walk.checkpoints,
            trajectory=walk.trajectory,
        )
        for walk in told
    ]
    far = {(0, 1): links_between(*(side_of(walk, KNOWN) for walk in true), KNOWN)}
    missed_m = []
    for walks in (wrong, [replace(walk, checkpoints=None) for walk in wrong]):
        made = joined_walks(walks, [np.zeros(3)] * 2, far, KNOWN, known_starts=True)
        pairs = zip(made, true, strict=True)
        poses = [(one.world_from_body, other.trajectory.world_from_body) for one, other in pairs]
        missed_m.append([off_m(*both) for both in poses])
    assert max(missed_m[0]) < 0.5 * min(missed_m[1])
    assert max(missed_m[0]) < KNOWN.checkpoint.sigma_m


def moved(walk: MappedWalk, by_m: F64) -> MappedWalk:
    """The same walk elsewhere: its dead reckoning, its trajectory, and what was tapped."""
    told = walk.checkpoints
    odometry, trajectory = (
        replace(each, world_from_body=shifted(each.world_from_body, by_m))
        for each in (walk.odometry, walk.trajectory)
    )
    if told is not None and told.xy_m is not None:
        told = replace(told, xy_m=told.xy_m + by_m)
    return replace(walk, odometry=odometry, trajectory=trajectory, checkpoints=told)


@pytest.mark.parametrize("by_m", FAR_M, ids=["1 km", "UTM"])
@pytest.mark.parametrize("taps", [[], [2, 15, 30, 45]], ids=["starts", "taps"])
def test_moving_the_frame_moves_the_walks_and_leaves_every_covariance(
    walker: Callable, here: Callable, taps: list[int], by_m: F64
) -> None:
    walks = [walker(here, str(k), start=[2.0 * k, 0.0, 0.0]) for k in range(2)]
    walks = [tapped(walk, taps) if taps else walk for walk in walks]
    links = {(0, 1): links_between(*(side_of(walk, KNOWN) for walk in walks), KNOWN)}
    far = [moved(walk, by_m) for walk in walks]
    made, there = (
        joined_walks(each, [np.zeros(3)] * 2, links, KNOWN, known_starts=True)
        for each in (walks, far)
    )
    spots = side_of(walks[0], KNOWN).poses
    made.append(against_map(walks[1], np.zeros(3), spots, links[0, 1], KNOWN, known_start=True))
    spots = shifted(spots, by_m)
    there.append(against_map(far[1], np.zeros(3), spots, links[0, 1], KNOWN, known_start=True))
    for one, other in zip(made, there, strict=True):
        moved_m = other.world_from_body[:, :2] - one.world_from_body[:, :2]
        npt.assert_allclose(moved_m - by_m, 0, atol=1e-5)
        npt.assert_allclose(other.covariance, one.covariance, rtol=1e-4, atol=1e-8)


def test_no_start_in_a_known_frame_is_surer_than_another(walker: Callable, here: Callable) -> None:
    walks = [walker(here, str(k), start=[20.0 * k, 0.0, 0.0]) for k in range(2)]
    far = {(0, 1): links_between(*(side_of(walk, KNOWN) for walk in walks), KNOWN)}
    made = joined_walks(walks, [np.zeros(3)] * 2, far, KNOWN, known_starts=True)
    sigmas_m = [np.sqrt(walk.covariance[0, 0, 0]) for walk in made]
    npt.assert_allclose(sigmas_m, KNOWN.merging.start_sigma_m, rtol=0.05)


def test_a_map_stays_where_it_is_and_bends_the_walk(walker: Callable, here: Callable) -> None:
    spots = side_of(walker(here, "map", seed=1), KNOWN)
    walk = second_order_inflated(walker(here, "walk", seed=2), 0.01)
    side = side_of(walk, KNOWN)
    links = links_between(spots, side, KNOWN)
    made = against_map(walk, np.zeros(3), spots.poses, links, KNOWN)
    wanted = walker(here, "walk", seed=2).trajectory.world_from_body
    bent = walk.trajectory.world_from_body
    assert off_m(made.world_from_body, wanted) < 0.35 < off_m(bent, wanted)


def test_middles_lie_half_way() -> None:
    poses = np.array([[0.0, 0.0, 0.3], [1.0, 2.0, 1.0]])
    npt.assert_allclose(middles(poses), [[0.5, 1.0, 0.3]])
    npt.assert_allclose(compose(poses[0], between(poses[0], middles(poses)[0])), middles(poses)[0])

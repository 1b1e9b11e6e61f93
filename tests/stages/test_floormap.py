"""A walk becomes spots: one per echo, between the footsteps where it was heard."""

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.values import ELF_SIZE, Features, FloorMap, Payload, Trajectory
from elfslam.stages import floormap
from elfslam.stages.floormap import QualityParameters, map_quality, spot_means, superimposed


def features(t_s: F64, size: int = 6) -> Features:
    vectors = np.random.default_rng(0).normal(size=(len(t_s), size))
    vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
    return Features(t_s, vectors, "stub")


def trajectory() -> Trajectory:
    """Four footsteps at 1 to 4 s: two ahead, then a turn to the left across the wrap of pi."""
    poses = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 3.0], [2, 3, -3.0]])
    covariance = np.arange(1, 5)[:, None, None] * np.diag([0.1, 0.2, 0.3])
    return Trajectory([1.0, 2.0, 3.0, 4.0], poses, covariance, [], "OK")


def made_map(given: Features, window_s: float = 0.6) -> FloorMap:
    parameters = floormap.FloorMapParameters(window_s=window_s)
    return floormap.trajectory_map(
        trajectory(), given, parameters, parameters_digest="d", source="walk"
    )


def test_each_echo_between_the_footsteps_gives_a_spot_where_it_was_heard() -> None:
    t_s = np.array([0.5, 1.0, 1.25, 2.5, 3.5, 4.0, 4.5])
    floor_map = made_map(features(t_s))
    npt.assert_allclose(floor_map.xy_m, [[0, 0], [0.25, 0], [1.5, 0], [2, 1.5], [2, 3]])
    npt.assert_allclose(floor_map.heading_rad, [0, 0, 1.5, -np.pi, -3.0])
    npt.assert_array_equal(floor_map.order, np.arange(5))
    npt.assert_array_equal(floor_map.walk, 0)
    npt.assert_array_equal(floor_map.payloads[0].vectors.shape, (5, 6))


def test_a_spot_is_as_uncertain_as_the_footstep_before_it() -> None:
    floor_map = made_map(features(np.array([1.0, 1.9, 2.0, 3.9, 4.0])))
    wanted = [[[k * 0.1, 0], [0, k * 0.2]] for k in (1, 1, 2, 3, 4)]
    npt.assert_allclose(floor_map.covariance_m2, wanted)


def test_the_map_says_where_it_comes_from() -> None:
    floor_map = made_map(features(np.array([1.5, 2.5])))
    assert floor_map.parameters_digest == "d"
    assert floor_map.sources == ("walk",)
    assert [(item.kind, item.encoder) for item in floor_map.payloads] == [("elf", "stub")]


@pytest.mark.parametrize("window_s", [0.1, 0.6, 1.0])
def test_a_spot_sounds_like_the_mean_of_its_window(window_s: float) -> None:
    t_s = np.delete(1.0 + 0.1 * np.arange(31), [7, 8, 20])
    given = features(t_s)
    half_s = window_s / 2 + 1e-6
    naive = [given.vectors[np.abs(t_s - at_s) <= half_s].mean(axis=0) for at_s in t_s]
    npt.assert_allclose(made_map(given, window_s).payloads[0].vectors, naive, atol=1e-6)


def test_echoes_outside_the_walk_still_sound_at_its_ends() -> None:
    given = features(np.array([0.8, 1.0, 1.2]))
    mean = given.vectors.mean(axis=0)
    npt.assert_allclose(made_map(given).payloads[0].vectors[0], mean, atol=1e-6)


def test_a_window_without_echoes_is_zero() -> None:
    given = features(np.array([1.0, 1.1]))
    means = floormap.window_means(given, np.array([1.05, 3.0]), 0.6)
    npt.assert_allclose(means, [given.vectors.mean(axis=0), np.zeros(6)], atol=1e-6)


SPACING_M = 0.3


def walked_both_ways() -> FloorMap:
    """Two spots, each heard twice eastward and once westward; the covariance of spot k is k."""
    xy_m = np.array([[0.1, 0.1], [0.12, 0.1], [0.14, 0.1], [1.0, 0.1], [1.02, 0.1], [1.04, 0.1]])
    vectors = np.zeros((6, ELF_SIZE), np.float32)
    vectors[:, 0] = [1, 1, 3, 5, 5, 9]
    return FloorMap(
        xy_m=xy_m,
        heading_rad=np.tile([0.0, 0.05, np.pi], 2),
        walk=np.tile([0, 0, 1], 2),
        order=np.arange(6),
        covariance_m2=np.arange(6)[:, None, None] * np.eye(2),
        payloads=(Payload("elf", "plain", vectors),),
        parameters_digest="",
        sources=("there", "back"),
    )


def test_spots_lie_in_the_middle_of_what_was_heard_in_each_square() -> None:
    xy_m = np.array([[0.01, 0.02], [0.03, 0.04], [-0.05, 0.05], [1.0, 1.0]])
    found = floormap.floor_spots(xy_m, 0.1)
    np.testing.assert_allclose(sorted(found.tolist()), [[-0.05, 0.05], [0.02, 0.03], [1.0, 1.0]])


def test_a_spot_of_several_walks_is_their_mean_over_headings() -> None:
    floor_map = walked_both_ways()
    made = superimposed(floor_map, floor_map.payloads[0], SPACING_M)
    np.testing.assert_allclose(made.xy_m, [[0.12, 0.1], [1.02, 0.1]])
    np.testing.assert_allclose(made.payloads[0].vectors[:, 0], [2, 7])
    assert made.sources == floor_map.sources


def test_a_spot_is_as_sure_as_the_walk_nearest_to_it_and_its_square_is_wide() -> None:
    floor_map = walked_both_ways()
    made = superimposed(floor_map, floor_map.payloads[0], SPACING_M)
    np.testing.assert_allclose(made.covariance_m2[:, 0, 0], np.array([1, 4]) + SPACING_M**2 / 12)


def test_the_map_holds_one_elf_for_each_spot() -> None:
    vectors = np.eye(2, ELF_SIZE, dtype=np.float32)
    made = floormap.superimposed_map(
        np.eye(2), vectors, "plain", spacing_m=SPACING_M, sources=("a", "b")
    )
    (payload,) = made.payloads
    assert (payload.kind, payload.encoder) == ("elf", "plain")
    np.testing.assert_array_equal(payload.vectors, vectors)
    np.testing.assert_allclose(made.covariance_m2[0], np.eye(2) * 0.0075)
    assert made.sources == ("a", "b")


def test_directions_count_alike_however_often_they_were_walked() -> None:
    spots_m = np.array([[0.0, 0.0], [5.0, 0.0], [9.0, 0.0]])
    at = np.array([[0.1, 0.0]] * 4 + [[4.9, 0.1]])
    heading_rad = np.array([0.0, 0.05, -0.05, np.pi, 1.0])
    vectors = np.array([[1.0], [1.0], [1.0], [3.0], [7.0]], dtype=np.float32)
    found = spot_means(spots_m, [(at, heading_rad, vectors)])
    assert found[:, 0].tolist() == [2.0, 7.0, 0.0], "mean of 1 and 3; the last was never heard"
    parts = [(at[k], heading_rad[k], vectors[k]) for k in ([2, 3], [0, 1, 4])]
    npt.assert_allclose(spot_means(spots_m, parts), found)


KNOWN = QualityParameters()


def floor_map(walk: list[int]) -> FloorMap:
    """Four spots in two squares; those of a place sound alike, the last pair 0.5 m apart."""
    return FloorMap(
        xy_m=np.array([[0.2, 0.2], [0.3, 0.2], [-3.5, 4.2], [-3.5, 4.7]]),
        heading_rad=np.zeros(4),
        walk=walk,
        order=np.arange(4),
        covariance_m2=np.eye(2) * np.array([0.01, 0.03, 0.04, 0.04])[:, None, None],
        payloads=(Payload("elf", "e", np.eye(2)[[0, 0, 1, 1]]),),
        parameters_digest="",
        sources=("a", "b"),
        weight=[0.5, 1.0, 1.0, 1.0],
        changed=[True, False, True, True],
    )


def test_squares_hold_their_spots() -> None:
    found = map_quality(floor_map([0, 1, 0, 1]), KNOWN)
    npt.assert_allclose(found.xy_m, [[-3.5, 4.5], [0.5, 0.5]])
    npt.assert_array_equal(found.spots, [2, 2])
    npt.assert_array_equal(found.walks, [2, 2])
    npt.assert_allclose(found.weight, [1.0, 0.75])
    npt.assert_allclose(found.sigma_m, np.sqrt([0.04, 0.02]))
    npt.assert_array_equal(found.changed, [True, False])


def test_the_error_is_how_far_the_best_match_of_another_walk_lies() -> None:
    npt.assert_allclose(map_quality(floor_map([0, 1, 0, 1]), KNOWN).error_m, [0.5, 0.1])


def test_one_walk_alone_cannot_tell_its_error() -> None:
    found = map_quality(floor_map([0, 0, 0, 0]), KNOWN)
    assert np.isnan(found.error_m).all()
    assert (found.walks == 1).all()


def test_larger_squares_are_fewer() -> None:
    assert len(map_quality(floor_map([0, 1, 0, 1]), QualityParameters(cell_m=50.0)).spots) == 2

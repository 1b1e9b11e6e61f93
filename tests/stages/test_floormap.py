"""A walk becomes spots: one per echo, between the footsteps where it was heard."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.base.arrays import F64
from elfslam.base.values import Features, FloorMap, Trajectory
from elfslam.stages.floormap import FloorMapParameters, trajectory_map, window_means


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
    parameters = FloorMapParameters(window_s=window_s)
    return trajectory_map(trajectory(), given, parameters, parameters_digest="d", source="walk")


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
    naive = [
        given.vectors[np.abs(t_s - centre) <= window_s / 2 + 1e-6].mean(axis=0) for centre in t_s
    ]
    npt.assert_allclose(made_map(given, window_s).payloads[0].vectors, naive, atol=1e-6)


def test_echoes_outside_the_walk_still_sound_at_its_ends() -> None:
    given = features(np.array([0.8, 1.0, 1.2]))
    npt.assert_allclose(
        made_map(given).payloads[0].vectors[0], given.vectors.mean(axis=0), atol=1e-6
    )


def test_a_window_without_echoes_is_zero() -> None:
    given = features(np.array([1.0, 1.1]))
    means = window_means(given, np.array([1.05, 3.0]), 0.6)
    npt.assert_allclose(means, [given.vectors.mean(axis=0), np.zeros(6)], atol=1e-6)

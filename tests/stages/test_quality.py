"""Quality by square metre: what is counted, and how far other walks are off."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt

from elfslam.base.values import FloorMap, Payload
from elfslam.stages.quality import QualityParameters, map_quality

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

"""Superimposed maps: spots, their features and how sure they are."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt

from elfslam.base.values import ELF_SIZE, FloorMap, Payload
from elfslam.stages.superimposition import floor_spots, spot_means, superimposed, superimposed_map

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
    found = floor_spots(xy_m, 0.1)
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
    made = superimposed_map(np.eye(2), vectors, "plain", spacing_m=SPACING_M, sources=("a", "b"))
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

"""Routes across mapped ones: on free floor, off the lap in one part and on it in the other."""

from __future__ import annotations

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.world.kinds import LEFT_OUT_M, crossing_route
from elfslam.world.materials import material
from elfslam.world.room import box, shoebox
from elfslam.world.walkable import fault_of_route
from elfslam.world.walker import smooth_lap
from elfslam.world.world_file import load_world

PLASTER = (material("plaster"),) * 6
ROUTE_M = np.array([[1.0, 1.0], [9.0, 1.0], [9.0, 7.0], [1.0, 7.0]])


def away_m(points_m: F64, route_m: F64) -> F64:
    lap_xy, _ = smooth_lap(route_m)
    return np.linalg.norm(points_m[:, None] - lap_xy[None, ::5], axis=2).min(axis=1)


@pytest.mark.parametrize("seed", range(5))
def test_a_part_is_kept_and_a_part_cut_across(seed: int) -> None:
    room = shoebox(np.array([10.0, 8.0, 3.0]), PLASTER)
    route_m = crossing_route(room, ROUTE_M, np.random.default_rng(seed))
    lap_xy, length_m = smooth_lap(route_m)
    off_m = away_m(lap_xy, ROUTE_M)
    assert off_m.max() > LEFT_OUT_M
    assert 0.3 < (off_m < 0.3).mean() < 0.95
    assert length_m < smooth_lap(ROUTE_M)[1]


@pytest.mark.parametrize("world", ["studio", "lounge", "concourse"])
def test_nobody_walks_through_furniture(world: str) -> None:
    place = load_world(world)
    for seed in range(3):
        route_m = crossing_route(place.room, place.route_m, np.random.default_rng(seed))
        assert route_m is not place.route_m
        ends_m = route_m[[-1, 0]]
        assert fault_of_route(place.room, np.vstack([ends_m, ends_m[:1]]), closed=False) is None


def test_where_nothing_leads_across_the_route_stays() -> None:
    filled = box("block", np.array([1.4, 1.4, 0.0]), np.array([7.2, 5.2, 2.0]))
    room = shoebox(np.array([10.0, 8.0, 3.0]), PLASTER, (filled,))
    assert crossing_route(room, ROUTE_M, np.random.default_rng(0)) is ROUTE_M

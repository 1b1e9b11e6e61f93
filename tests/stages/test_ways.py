"""Ways: planted corridors and floors, the laws of a shortest path, and what is not joined."""

from itertools import pairwise

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.building import Passage
from elfslam.base.errors import InputError
from elfslam.base.values import LevelPassage
from elfslam.stages import ways

STAIRS = Passage(LevelPassage.STAIRS, 0, 1, (10.0, 0.0), (10.0, 3.0), 15.0)
LIFT = Passage(LevelPassage.LIFT, 0, 1, (30.0, 0.0), (30.0, 0.2), 10.0)
ESCALATOR = Passage(LevelPassage.ESCALATOR, 0, 1, (2.0, 0.0), (2.0, 2.0), 12.0)


def walked(*corners_m: tuple[float, float], seed: int = 0, sigma_m: float = 0.0) -> F64:
    """Places every 14 cm along a line, as far off it as people stray."""
    pieces = []
    for one, other in pairwise(np.array(corners_m, dtype=float)):
        count = int(np.linalg.norm(other - one) / 0.14) + 1
        pieces.append(one + np.linspace(0, 1, count)[:, None] * (other - one))
    line = np.concatenate(pieces)
    return np.asarray(line + np.random.default_rng(seed).normal(0, sigma_m, line.shape))


def two_floors(*passages: Passage) -> ways.WayGraph:
    ground = {0: walked((0, 0), (30, 0)), 1: walked((0, 3), (30, 3), (30, 0))}
    return ways.way_graph(ground, passages)


def at(level: int, x_m: float, y_m: float) -> ways.LevelPosition:
    return ways.LevelPosition(level, (x_m, y_m))


def found(graph: ways.WayGraph, start: ways.LevelPosition, goal: ways.LevelPosition) -> ways.Route:
    route = ways.way(graph, start, goal)
    assert route is not None
    return route


@pytest.mark.parametrize("seed", range(3))
def test_a_corridor_is_as_long_as_it_is(seed: int) -> None:
    rounds = [walked((0, 0), (40, 0), (40, 25), seed=seed + k, sigma_m=0.15) for k in (10, 20)]
    graph = ways.way_graph({0: np.concatenate(rounds)}, ())
    route = found(graph, at(0, 0.0, 0.0), at(0, 40.0, 25.0))
    assert route.length_m == pytest.approx(65, rel=0.05)
    assert route.duration_s == pytest.approx(route.length_m / ways.WALKING_MPS)
    assert [leg.level for leg in route.legs] == [0]


def test_a_way_goes_round_a_wall_that_nobody_walked_through() -> None:
    graph = ways.way_graph({0: walked((0, 0), (10, 0), (10, 1), (0, 1))}, ())
    route = found(graph, at(0, 0.0, 0.0), at(0, 0.0, 1.0))
    assert route.length_m == pytest.approx(21, abs=1)
    np.testing.assert_allclose(ways.corners(route.legs[0].xy_m, 1.0)[1:-1, 0], 10, atol=0.6)


def test_floors_are_joined_by_the_quicker_passage() -> None:
    graph = two_floors(STAIRS, LIFT)
    near = found(graph, at(0, 5.0, 0.0), at(1, 5.0, 3.0))
    assert [leg.leaves_by for leg in near.legs] == [LevelPassage.STAIRS, None]
    assert [leg.level for leg in near.legs] == [0, 1]
    assert near.length_m == pytest.approx(5 + 3 + 5, abs=0.3)
    assert near.duration_s == pytest.approx(10 / ways.WALKING_MPS + STAIRS.duration_s, abs=0.3)
    np.testing.assert_array_equal(near.legs[0].xy_m[-1], STAIRS.from_xy_m)
    np.testing.assert_array_equal(near.legs[1].xy_m[0], STAIRS.to_xy_m)
    far = found(two_floors(LIFT), at(0, 5.0, 0.0), at(1, 30.0, 3.0))
    assert far.duration_s == pytest.approx(27.8 / ways.WALKING_MPS + 10 + ways.LIFT_WAIT_S, abs=0.5)


def test_stairs_are_not_taken_by_who_avoids_them() -> None:
    passages = ways.without_steps([STAIRS, LIFT, ESCALATOR])
    route = found(two_floors(*passages), at(0, 5.0, 0.0), at(1, 5.0, 3.0))
    assert [leg.leaves_by for leg in route.legs] == [LevelPassage.LIFT, None]


def test_an_escalator_leads_one_way() -> None:
    graph = two_floors(ESCALATOR)
    low, high = at(0, 5.0, 0.0), at(1, 5.0, 3.0)
    assert found(graph, low, high).legs[0].leaves_by is LevelPassage.ESCALATOR
    assert ways.way(graph, high, low) is None


def test_what_no_walk_joins_is_refused() -> None:
    low, high = at(0, 0.0, 0.0), at(1, 0.0, 3.0)
    assert ways.way(two_floors(), low, high) is None
    apart = ways.way_graph({0: walked((0, 0), (3, 0)), 1: walked((0, 9), (3, 9))}, [STAIRS])
    assert ways.way(apart, low, at(1, 0.0, 9.0)) is None
    with pytest.raises(InputError, match="nothing was walked on level 2, wanted one of 0, 1"):
        ways.way(two_floors(), low, at(2, 0.0, 0.0))
    with pytest.raises(InputError, match="wanted one of none"):
        ways.way(ways.way_graph({}, [STAIRS]), low, high)


@pytest.mark.parametrize("seed", range(3))
def test_durations_are_a_metric(seed: int) -> None:
    generator = np.random.default_rng(100 + seed)
    ground = {k: generator.uniform(0, 8, (500, 2)) for k in (0, 1)}
    ends = generator.uniform(0, 8, (3, 4))
    kinds = (LevelPassage.STAIRS, LevelPassage.LIFT, LevelPassage.STAIRS)
    passages = [
        Passage(kind, 0, 1, (a, b), (c, d), 12.0)
        for kind, (a, b, c, d) in zip(kinds, ends.tolist(), strict=True)
    ]
    graph = ways.way_graph(ground, passages)
    chosen = generator.choice(graph.first_end, (12, 3))
    for rows in chosen:
        at_rows = ((int(graph.level[k]), *graph.xy_m[k].tolist()) for k in rows)
        one, other, third = (at(*place) for place in at_rows)
        direct, back = found(graph, one, third), found(graph, third, one)
        first, second = found(graph, one, other), found(graph, other, third)
        assert direct.duration_s <= first.duration_s + second.duration_s + 1e-9
        assert direct.duration_s == pytest.approx(back.duration_s)
        assert direct.length_m >= np.linalg.norm(np.subtract(one.xy_m, third.xy_m)) - 1e-9


def test_a_passage_beside_walked_ground_is_joined_to_it_up_to_a_limit() -> None:
    for off_m, is_joined in ((ways.REACH_M / 2, True), (4.9, True), (5.1, False)):
        lift = Passage(LevelPassage.LIFT, 0, 1, (10.0, -off_m), (30.0, 0.0), 10.0)
        route = ways.way(two_floors(lift), at(0, 10.0, 0.0), at(1, 30.0, 0.0))
        assert (route is not None) == is_joined


def test_corners_are_what_is_left_of_a_line() -> None:
    line = walked((0, 0), (10, 0), (10, 8))
    np.testing.assert_allclose(ways.corners(line, 0.5), [[0, 0], [10, 0], [10, 8]], atol=1e-9)
    np.testing.assert_array_equal(ways.corners(line[:2], 0.5), line[:2])


def test_a_way_is_told_by_its_turns_and_passages() -> None:
    graph = two_floors(LIFT)
    told = ways.moves_of(found(graph, at(0, 5.0, 0.0), at(1, 12.0, 3.0)))
    assert [(each.level, each.after) for each in told] == [(0, "start"), (1, "lift"), (1, "left")]
    np.testing.assert_allclose([each.length_m for each in told], [25, 2.8, 18], atol=0.5)

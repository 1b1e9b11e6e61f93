"""Floor changes from planted pressure curves; what is none; and dead reckoning on the way."""

from dataclasses import replace

import numpy as np
import pytest

from elfslam.base.arrays import F64
from elfslam.base.building import BuildingFloor, FloorsVisited
from elfslam.base.geometry import chain
from elfslam.base.values import Barometer, Checkpoints, LevelPassage, Levels, Odometry
from elfslam.stages import levels as levelling
from tests.stages.pressure import Part, walk_of

AS_IT_IS = levelling.LevelParameters()
WALK: Part = (60.0, 0.0, 1.8)
STAIRS, LIFT, ESCALATOR = LevelPassage
UP: tuple[Part, ...] = ((7.0, 1.75, 1.8), (3.0, 0.0, 1.8), (7.0, 1.75, 1.8))
"""Two flights of stairs and a landing."""


def told(barometer: Barometer, footsteps_t_s: F64) -> tuple[list[float], list[LevelPassage]]:
    """The levels in their order, and what led from each to the next."""
    levels = levelling.find_levels(barometer, footsteps_t_s, AS_IT_IS).levels
    floors = [float(each) for each in levels.level if np.isfinite(each)]
    return floors, [each for each in levels.passages if each is not None]


@pytest.mark.parametrize("seed", range(100, 105))
def test_stairs_lift_and_escalator_lead_up_and_back_to_the_floor_of_the_start(seed: int) -> None:
    down = (14.0, -3.5, 0.0), WALK, (12.0, -3.5, 1.8), WALK
    parts = (WALK, *UP, WALK, (6.0, 3.5, 0.0), WALK, *down)
    barometer, footsteps = walk_of(parts, seed=seed)
    found = levelling.find_levels(barometer, footsteps, AS_IT_IS)
    floors, by = told(barometer, footsteps)
    assert floors == [0, 1, 2, 1, 0]
    assert by == [STAIRS, LIFT, ESCALATOR, STAIRS]
    assert [each.level for each in found.floors] == [0, 1, 2]
    np.testing.assert_allclose([each.height_m for each in found.floors], [0, 3.5, 7], atol=0.6)
    np.testing.assert_allclose(found.levels.t_s[1:3], [60, 77], atol=4)


def test_neither_a_constant_nor_the_weather_changes_anything() -> None:
    barometer, footsteps = walk_of((WALK, *UP, WALK, (6.0, -3.5, 0.0), WALK) * 5, wind_hpa=0.0)
    found = levelling.find_levels(barometer, footsteps, AS_IT_IS)
    assert told(barometer, footsteps)[0] == [0, *(1, 0) * 5]
    for offset_hpa, ramp_hpa in ((10.0, 0.0), (0.0, 1.0), (-30.0, -1.0)):
        moved = barometer.pressure_hpa + offset_hpa + ramp_hpa * barometer.t_s / 3600
        again = levelling.find_levels(replace(barometer, pressure_hpa=moved), footsteps, AS_IT_IS)
        assert np.array_equal(again.levels.level, found.levels.level, equal_nan=True)
        assert again.levels.passages == found.levels.passages
        np.testing.assert_allclose(again.levels.t_s, found.levels.t_s, atol=1.0)


@pytest.mark.parametrize(
    "parts",
    [
        (WALK, (0.4, 3.0, 1.8), WALK),
        (WALK, (0.4, -3.0, 1.8), (15.0, 0.0, 1.8), (0.4, 3.0, 1.8), WALK),
        (WALK, (4.0, 2.5, 0.0), (2.0, 0.0, 0.0), (4.0, -2.5, 0.0), WALK),
        (WALK, (7.0, 1.2, 1.8), WALK),
        (WALK, (600.0, 5.0, 1.8), WALK),
    ],
    ids=["door", "door and back", "gust", "a few steps", "weather"],
)
def test_what_is_no_floor_change_makes_none(parts: tuple[Part, ...]) -> None:
    for seed in range(100, 105):
        assert told(*walk_of(parts, seed=seed)) == ([0], [])


def test_an_hour_in_the_wind_has_no_floor_change() -> None:
    barometer, footsteps = walk_of([(3600.0, 0.0, 1.8)], wind_hpa=0.05)
    assert told(barometer, footsteps) == ([0], [])


def test_one_sample_a_second_will_do() -> None:
    barometer, footsteps = walk_of((WALK, *UP, WALK, (0.4, 2.5, 1.8), WALK), rate_hz=1.0)
    assert told(barometer, footsteps) == ([0, 1], [STAIRS])


@pytest.mark.parametrize(("flight_m", "rest_s"), [(UP[0][1], 40.0), (2.7, 9.0)])
def test_who_rests_on_a_landing_climbs_one_floor(flight_m: float, rest_s: float) -> None:
    flight = (UP[0][0], flight_m, UP[0][2])
    parts = (WALK, flight, (rest_s, 0.0, 0.0), flight, WALK)
    assert told(*walk_of(parts)) == ([0, 1], [STAIRS])


def test_floors_that_a_lift_passes_are_counted_and_cellars_lie_below() -> None:
    parts = (WALK, (12.0, -3.5, 1.8), WALK, (14.0, 14.0, 0.0), WALK)
    assert told(*walk_of(parts)) == ([0, -1, 3], [STAIRS, LIFT])


@pytest.mark.parametrize(
    ("heights_m", "levels"),
    [((5.5,), 1), ((6.8,), 2), ((10.2,), 3), ((3.1, 10.1), 3), ((5.0, 10.0), 2)],
)
def test_storeys_are_counted_by_likely_heights(heights_m: tuple[float, ...], levels: int) -> None:
    rises = np.diff([0.0, *heights_m])
    parts = [part for rise in rises for part in (WALK, (rise, float(rise), 0.0))]
    assert told(*walk_of((*parts, WALK)))[0][-1] == levels


def test_who_walks_on_an_escalator_gets_further_up_a_footstep_than_stairs_let() -> None:
    assert told(*walk_of((WALK, (7.0, 5.0, 1.8), WALK)))[1] == [ESCALATOR]


def test_too_short_a_curve_is_one_floor() -> None:
    short = Barometer(np.array([5.0, 6.0]), np.array([1000.0, 999.0]))
    levels = levelling.find_levels(short, np.zeros(0), AS_IT_IS).levels
    assert (levels.t_s.tolist(), levels.level.tolist()) == ([5.0], [0.0])


TAPS = Checkpoints(np.array([10.0, 30.0, 45.0, 60.0]), ("Door", "Stairs", "Level 2", "Door"), None)


def test_without_a_barometer_floors_are_those_that_were_named() -> None:
    visited = levelling.levels_by_taps(TAPS, 0.0, AS_IT_IS)
    assert visited.levels.t_s.tolist() == [0, 30, 45]
    assert np.array_equal(visited.levels.level, [0, np.nan, 2], equal_nan=True)
    assert visited.levels.passages == (None, STAIRS, None)
    assert visited.floors == (BuildingFloor(0, 0.0), BuildingFloor(2, 7.6))


def test_taps_that_name_places_alone_name_no_floor() -> None:
    places = Checkpoints(np.array([1.0, 2.0]), ("Stairs", "Door"))
    assert levelling.levels_by_taps(places, 0.0, AS_IT_IS) is None
    assert levelling.levels_by_taps(None, 0.0, AS_IT_IS) is None
    assert levelling.without_level_taps(places) is places


def test_a_floor_that_was_named_is_no_place_to_come_back_to() -> None:
    left = levelling.without_level_taps(TAPS)
    assert (left.names, left.t_s.tolist()) == (("Door", "Door"), [10.0, 60.0])


def test_a_tap_says_which_floor_the_first_is() -> None:
    levels = Levels(np.array([0.0, 29.0, 44.0]), np.array([0, np.nan, -1]), (None, STAIRS, None))
    found = FloorsVisited(levels, (BuildingFloor(-1, -3.0), BuildingFloor(0, 0.0)))
    numbered = levelling.numbered_by_taps(found, TAPS)
    assert np.array_equal(numbered.levels.level, [3, np.nan, 2], equal_nan=True)
    assert [each.level for each in numbered.floors] == [2, 3]
    assert levelling.numbered_by_taps(found, None).floors == found.floors


@pytest.mark.parametrize(
    ("kind", "wanted_m"), [(STAIRS, 0.29 * 20), (LIFT, 0.0), (ESCALATOR, 0.29 * 20 + 6.93 + 2.5)]
)
def test_steps_between_floors_are_as_long_as_what_they_are_taken_on_lets_them(
    kind: LevelPassage, wanted_m: float
) -> None:
    moves = np.tile([0.7, 0.0, 0.01], (60, 1))
    nodes = Odometry(np.arange(61) * 0.5, chain(np.zeros(3), moves), np.full((60, 3), 0.01))
    levels = Levels(np.array([0.0, 10.0, 20.0]), np.array([0, np.nan, 1]), (None, kind, None))
    visited = FloorsVisited(levels, (BuildingFloor(0, 0.0), BuildingFloor(1, 4.0)))
    moved = levelling.reckoned_on_passages(nodes, visited, AS_IT_IS)
    steps_m = np.linalg.norm(np.diff(moved.world_from_body[:, :2], axis=0), axis=1)
    np.testing.assert_allclose(steps_m[[0, 19, 40, 59]], 0.7)
    np.testing.assert_allclose(steps_m[20:40].sum(), wanted_m, atol=0.01)
    np.testing.assert_allclose(moved.world_from_body[:, 2], nodes.world_from_body[:, 2])
    assert (moved.step_sigma[20:40, 0] > nodes.step_sigma[20:40, 0]).all()

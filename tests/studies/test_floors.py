"""Floors of buildings in small: planted ways, plans that put walks right, and a city's Wi-Fi."""

import numpy as np
import numpy.testing as npt
import pytest

from elfslam.stages.ways import LevelPosition, way, way_graph
from elfslam.world.kinds import PEOPLE, QUIET
from studies import floors as study
from studies import floors_by_wifi, passages
from studies.floors import BAROMETER, DEAD_RECKONING, STUDY, FloorWalk, measure_floors
from studies.floors_by_wifi import CityParameters, Hearing, block_of, mean_levels_dbm, scans_in
from studies.passages import ECHOES, GIVEN_START, MATCHED, MEDIAN, STEPS
from studies.plain_features import ELF, PLAIN
from studies.results import Record
from studies.study import MEDIAN_ALIGNED, StudyContext


@pytest.fixture(scope="module")
def records() -> list[Record]:
    return measure_floors(StudyContext(), **STUDY.fast, kind=PEOPLE)


def values_of(records: list[Record], method: str, condition: str) -> dict[str, float]:
    return {
        each.metric: each.value
        for each in records
        if each.method == method and each.condition.startswith(condition)
    }


def test_the_barometer_finds_the_floors_of_a_tower(records: list[Record]) -> None:
    found = values_of(records, BAROMETER, "mapped walk")
    assert found["floor right (%)"] > 95
    assert found["level changes found"] == found["level changes"] == 4
    assert values_of(records, BAROMETER, "one floor")["false level changes an hour"] == 0


def test_maps_are_nearer_than_dead_reckoning_and_lead_about_as_far(records: list[Record]) -> None:
    for level in range(4):
        mapped, reckoned = (
            values_of(records, name, f"map, floor {level}")[MEDIAN_ALIGNED]
            for name in (ELF, DEAD_RECKONING)
        )
        assert mapped < reckoned
    assert 0.7 < values_of(records, ELF, "ways, along")["way over truth, median"] < 1.3
    assert values_of(records, ELF, "fixes, barometer")["floor right (%)"] > 90
    assert values_of(records, PLAIN, "fixes, barometer")


def test_a_single_walk_has_no_interval(records: list[Record]) -> None:
    assert all(each.low is None for each in records if each.condition.startswith("ways"))


def test_a_grid_of_walkable_ground_leads_about_as_far_as_a_straight_line() -> None:
    x_m, y_m = np.meshgrid(np.arange(0.125, 20, 0.25), np.arange(0.125, 20, 0.25))
    graph = way_graph({0: np.column_stack([x_m.ravel(), y_m.ravel()])}, ())
    for goal in ((19.0, 1.0), (19.0, 19.0), (11.0, 17.0)):
        found = way(graph, LevelPosition(0, (1.0, 1.0)), LevelPosition(0, goal))
        assert 1 <= found.length_m / np.hypot(goal[0] - 1, goal[1] - 1) + 1e-3 < 1.05


def test_people_can_stand_where_they_walk() -> None:
    ground = study._walkable("tower")
    assert sorted(ground) == [0, 1, 2, 3]
    corridor = np.array([20.0, 7.0])
    assert np.linalg.norm(ground[0] - corridor, axis=1).min() < 0.25
    npt.assert_array_less(ground[0].max(axis=0), [40.0, 14.0])


def test_a_query_walks_the_two_highest_floors(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, ...]] = []
    monkeypatch.setattr(study, "simulate_building", lambda *_, plan, **__: asked.append(plan))
    study._walked(FloorWalk("tower", 100, "people", heard=True), asking=True)
    assert asked == [(3, 2)]


def test_a_plan_puts_a_walk_right() -> None:
    records = passages.measure_passages(StudyContext(), kind=QUIET, **passages.STUDY.fast)
    found = {(r.method, r.condition, r.metric): r.value for r in records}
    for method in (STEPS, ECHOES):
        assert found[method, MATCHED, MEDIAN] < found[method, GIVEN_START, MEDIAN]
        one, two = (found[method, MATCHED, f"within {many} sigma"] for many in ("one", "two"))
        assert 0 <= one <= two <= 1


PARAMETERS = CityParameters()
STILL = CityParameters(shadowing_db=0.0, fading_db=0.0, missed_share=0.0, hotspots=0.0)


def test_a_block_is_the_same_again_and_no_other() -> None:
    one, same, other = (block_of(1, column, PARAMETERS) for column in (2, 2, 3))
    npt.assert_array_equal(one.address, same.address)
    assert not set(one.address[one.address > 0]) & set(other.address[other.address > 0])
    generator = np.random.default_rng(0)
    assert len(scans_in(one, 0, 1, 5, generator, PARAMETERS).t_s) == 5


def test_levels_fall_with_distance_slabs_and_facades() -> None:
    block = block_of(1, 0, STILL)
    radio = int(np.argmax(block.house == 1))
    floor = int(block.position_m[radio, 2] // STILL.storey_m)
    near = block.position_m[radio] + [[2.0, 0, 0], [20.0, 0, 0]]
    levels = mean_levels_dbm(block, 1, floor, near, STILL)[:, radio]
    assert np.isclose(levels[0] - levels[1], 10 * block.exponent[1])
    above = mean_levels_dbm(block, 1, floor + 2, near, STILL)[:, radio]
    npt.assert_allclose(levels - above, STILL.slab_db + STILL.more_slabs_db)
    outside = mean_levels_dbm(block, 0, floor, near, STILL)[:, radio]
    between = 10 * (block.exponent[0] - block.exponent[1]) * np.log10([2.0, 20.0])
    npt.assert_allclose(levels - outside, 2 * STILL.facade_db + between)


def test_phones_hear_differently_and_radios_are_replaced() -> None:
    block = block_of(1, 0, STILL)

    def heard(hearing: Hearing) -> dict[str, float]:
        return floors_by_wifi.heard_now(
            scans_in(block, 0, 0, 1, np.random.default_rng(4), STILL, hearing), [0]
        )

    plain, deaf, aged = heard(Hearing()), heard(Hearing(deaf_db=7)), heard(Hearing(0, 0.5))
    assert all(abs(plain[name] - level - 7) <= 1 for name, level in deaf.items())
    assert len(deaf) < len(plain)
    assert 0.2 < len(aged.keys() & plain.keys()) / len(plain) < 0.8
    assert abs(len(aged) - len(plain)) <= 3

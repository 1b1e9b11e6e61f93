"""Studies of the page's modules in node: what a delay gives, and that echoes help a growing map."""

import shutil
from collections.abc import Iterator

import pytest

from studies.floors_by_wifi import AS_THEY_ARE, UNMAPPED, in_city
from studies.growing_map import measure_growing_map
from studies.live_footsteps import measure_live_footsteps
from studies.results import Record
from studies.study import StudyContext

needs_node = pytest.mark.skipif(shutil.which("node") is None, reason="node is not installed")


def values(records: Iterator[Record]) -> dict[tuple[str, str, str], float]:
    return {(each.method, each.condition, each.metric): each.value for each in records}


@needs_node
def test_half_a_second_is_enough_for_a_footstep() -> None:
    how = {"worlds": ("studio",), "seeds": (100,)}
    told = measure_live_footsteps(StudyContext(), delays_s=(0.1, 0.5), **how)
    found = {key[1:]: value for key, value in values(told).items()}
    assert found["0.5 s", "missed footsteps"] == 0
    assert found["0.5 s", "step length, rms (%)"] < 2
    turn = "turn of the walk, rms (deg)"
    assert found["0.5 s", turn] < 3 < found["0.1 s", turn]


@needs_node
@pytest.mark.real
def test_echoes_help_the_map_that_grows() -> None:
    found = values(measure_growing_map(StudyContext(), worlds={"lounge": 2}, walks=1))
    error_m = {method: value for (method, _, _), value in found.items()}
    assert error_m["map of the whole walk, ELF"] < error_m["growing map, ELF"]
    assert error_m["growing map, ELF"] < error_m["dead reckoning"]


def test_wifi_tells_the_floor_of_a_city_and_doubts_one_that_is_not_mapped() -> None:
    found = values(in_city(1))
    assert found[AS_THEY_ARE, "4 scans", "OK and right (%)"] > 70
    assert found[AS_THEY_ARE, "4 scans", "OK and wrong (%)"] < 5
    assert found[UNMAPPED, "1 scan", "OK and right (%)"] == 0
    assert found[UNMAPPED, "1 scan", "OK and wrong (%)"] < 20

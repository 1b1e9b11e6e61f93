"""The cost of a fleet: planted loads, what breaks where, refusals."""

import numpy as np
import pytest

from elfslam.base.errors import ParameterError
from studies.finding import Given
from studies.fleet import Costs, Demand, hourly, measure_fleet, stations_of, stores_of

CALM = Demand(buildings=10, phones=2000, first_share=0.5, walks_per_building=6, walk_minutes=2)
COSTS = Costs(lookup_s=0.01, page_bytes=1e6, package_bytes=2e6, update_bytes=1e6, run_bytes=0.0)


def rows(**changed):
    found = measure_fleet(Given(), demand=CALM, costs=COSTS, **changed).rows
    return {row["what"]: row for row in found}


def test_the_hours_of_a_day_add_up_to_it():
    assert hourly(1200.0).sum() == pytest.approx(1200)
    assert len(hourly(1.0)) == 24


def test_stations_get_the_work_that_people_make():
    finding, fetching, uploading, mapping = stations_of(CALM, COSTS)
    assert (finding.a_day, mapping.a_day) == (2000, 60)
    assert fetching.mean_s == pytest.approx(2e6 * 8 / 1e9)
    assert fetching.variation == pytest.approx(0.5)
    assert uploading.mean_s == pytest.approx(2 * COSTS.upload_bytes_per_minute * 8 / 1e9)
    assert mapping.mean_s == pytest.approx(
        COSTS.mapping_s + 2 * COSTS.mapping_s_per_minute + COSTS.merging_s
    )


def test_what_is_kept_grows_with_walks_and_maps_do_not():
    stores = stores_of(CALM, COSTS)
    assert stores["recordings"] == (0.0, pytest.approx(120 * COSTS.upload_bytes_per_minute))
    assert stores["maps, packages"][1] == 0.0


def test_formula_and_simulation_agree_and_what_is_overloaded_breaks():
    found = rows(times=(1, 5000))
    assert found["finding the map"]["breaks at"] == "5000 times"
    assert found["uploading walks"]["breaks at"] == "beyond 5000 times"
    assert found["finding the map"]["work a day"] == "0.01 h"


def test_the_same_seed_gives_the_same_table():
    assert rows(times=(1, 5), seed=3) == rows(times=(1, 5), seed=3)


def test_nobody_is_refused():
    with pytest.raises(ParameterError, match="phones: wanted more than 0, got 0"):
        Demand(phones=0)


def test_a_disk_fills_in_as_many_days_as_its_bytes_last():
    a_day = stores_of(CALM, COSTS)["runs"][1]
    assert rows(times=(1,), disk_bytes=7 * a_day)["runs"]["full"] == "7 days"
    assert np.isfinite(a_day)

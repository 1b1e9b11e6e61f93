"""The same results whoever works, and whoever is killed."""

from __future__ import annotations

import pytest

from elfslam.studies.scaling import Walk, measure_scaling, measure_walk


@pytest.mark.slow
def test_all_workers_give_the_same_and_a_killed_one_changes_nothing() -> None:
    pytest.importorskip("ray", reason="Ray is not installed")
    rows = measure_scaling(
        None, lambda *_: None, worlds=("studio",), seeds=range(100, 104), rounds=1
    )
    assert [row["same results"] for row in rows] == [True] * 5
    assert [row["killed"] for row in rows] == [0, 0, 1, 0, 1]
    assert {row["units"] for row in rows} == {4}
    assert min(float(str(row["units (s)"])) for row in rows) > 0


def test_a_unit_says_what_it_found() -> None:
    one, two = (measure_walk(Walk("studio", seed, 1))[0] for seed in (100, 100))
    assert one["median error (m)"] == two["median error (m)"] > 0

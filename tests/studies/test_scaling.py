"""The same results whoever works, and whoever is killed."""

from __future__ import annotations

import pytest

from studies.finding import Given
from studies.repeats import SimulatedWalk
from studies.scaling import measure_scaling, measure_walk, scaling_page


def test_all_workers_give_the_same_and_a_killed_one_changes_nothing() -> None:
    pytest.importorskip("ray", reason="Ray is not installed")
    finding = measure_scaling(Given(), worlds=("studio",), seeds=range(100, 104), rounds=2)
    rows = finding.rows
    assert [row["equal"] for row in rows] == [True] * 5
    assert [row["kills"] for row in rows] == [0, 0, 1, 0, 1]
    assert [row["lost (s)"] is None for row in rows] == [row["kills"] == 0 for row in rows]
    assert min(float(str(row["wall (s)"])) for row in rows) > 0
    assert finding.page is not None
    assert finding.page.tiles["equal results"] == "5 of 5"


def test_a_table_fits_a_terminal_and_a_difference_is_seen() -> None:
    row = {"workers": "Ray, 2 nodes", "kills": 1, "start (s)": 12.3}
    times = {"wall (s)": 100.0, "overhead (s)": 0.25, "lost (s)": 12.3, "equal": False}
    page = scaling_page([{**row, **times}, {**row, **times, "equal": True}], 1)
    assert page.tiles["equal results"] == "1 of 2"
    shown = [max(len(str(name)), len(str(cell))) for name, cell in {**row, **times}.items()]
    assert sum(shown) + 2 * (len(shown) - 1) <= 80


def test_a_unit_says_what_it_found() -> None:
    one, two = (measure_walk(SimulatedWalk("studio", seed, 1))[0] for seed in (100, 100))
    assert one["median error (m)"] == two["median error (m)"] > 0

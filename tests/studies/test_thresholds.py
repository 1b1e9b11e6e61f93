"""Thresholds of loops and fixes: planted numbers choose the best one, a small run has all rows."""

from __future__ import annotations

import pytest

from elfslam.app.settings import Settings
from studies import fix_thresholds, thresholds
from studies.finding import Given
from studies.fix_thresholds import measure_fix_thresholds
from studies.plain_features import CLOSURE_THRESHOLDS, ELF, closing_by, compared_encoders
from studies.simulated_walk import SimulatedWalk
from studies.thresholds import measure_thresholds

WALK = SimulatedWalk("studio", 0, 4, "people")


def planted(
    mapped_m: dict[str, float], closures: float = 10.0, right: float = 9.0
) -> dict[str, float]:
    numbers = {"reckoned": 1.0}
    for key, value in mapped_m.items():
        numbers |= {f"{key}|mapped": value, f"{key}|closures": closures, f"{key}|right": right}
    return numbers


def test_the_best_threshold_of_each_feature_is_marked() -> None:
    numbers = [
        planted({"a|0.1": 0.5, "a|0.2": 0.2, "b|0.1": 0.9, "b|0.2": 1.0}),
        planted({"a|0.1": 0.5, "a|0.2": 0.4, "b|0.1": 0.1, "b|0.2": 0.2}),
    ]
    rows = thresholds._rows([WALK, WALK], numbers)
    marked = {(row["feature"], row["threshold"]) for row in rows if row["best"]}
    assert marked == {("a", 0.2), ("b", 0.1)}
    assert [row["map over dead reckoning"] for row in rows] == [0.5, 0.283, 0.3, 0.447]
    assert rows[0]["people: right"] == 0.9


def test_where_nothing_closes_no_share_is_right() -> None:
    [row] = thresholds._rows([WALK], [planted({"a|0.6": 1.0}, 0.0, 0.0)])
    assert row["people: closures"] == 0.0
    assert row["people: right"] is None


def test_walks_without_an_answer_count_for_no_error() -> None:
    found = {"answered": 0.0, "median (m)": float("nan"), "over 1 m off": float("nan")}
    numbers = [
        {f"track|0.8|{what}": value for what, value in {**found, "elsewhere": 0.0}.items()},
        {f"track|0.8|{what}": 0.5 for what in fix_thresholds.WHAT},
    ]
    [row] = fix_thresholds._rows(
        [SimulatedWalk("studio", seed, 4, "people") for seed in (0, 1)], numbers
    )
    assert (row["answered"], row["median (m)"], row["elsewhere"]) == (0.25, 0.5, 0.25)


def test_the_elf_closes_as_the_line_does_by_itself() -> None:
    assert set(CLOSURE_THRESHOLDS) == set(compared_encoders())
    assert closing_by(ELF, Settings()) == Settings().closure


@pytest.mark.real
def test_a_small_run_has_a_row_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    quick = {"worlds": ("studio",), "seeds": (100,), "rounds": 2}
    finding = measure_thresholds(Given(), **quick)
    assert len(finding.rows) == len(compared_encoders()) * len(thresholds.THRESHOLDS)
    elf = [row for row in finding.rows if row["feature"] == ELF]
    assert min(float(str(row["map over dead reckoning"])) for row in elf) < 0.7
    monkeypatch.setattr(fix_thresholds, "UNKNOWN_BELOW", (0.4, 0.6, 0.78))
    fixes = measure_fix_thresholds(Given(), **quick).rows
    assert len(fixes) == 3 * 3 * 3
    for kind in ("people", "surveyor", "quiet"):
        for mode in ("one-shot", "trajectory", "track"):
            row = [each for each in fixes if (each["kind"], each["mode"]) == (kind, mode)]
            shares = [float(str(each["answered"])) for each in row]
            assert shares == sorted(shares, reverse=True)

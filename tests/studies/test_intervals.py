"""Means with their intervals, and curves of them."""

from __future__ import annotations

import numpy as np

from studies.intervals import by_measure, curve_of, mean_row


def test_a_mean_lies_in_its_interval_and_alike_values_have_none() -> None:
    row = mean_row("spots", 8, "recognised", [0.8, 0.9, 1.0], "repeats")
    assert (row["varied"], row["at"], row["measure"]) == ("spots", 8, "recognised")
    assert (row["mean"], row["over"]) == (0.9, "3 repeats")
    assert 0.8 <= row["from"] < 0.9 < row["to"] <= 1.0  # type: ignore[operator]
    alike = mean_row("spots", 8, "recognised", np.full(4, 0.5), "repeats")
    assert (alike["from"], alike["mean"], alike["to"]) == (0.5, 0.5, 0.5)


def test_rows_become_a_curve() -> None:
    curve = curve_of([mean_row("spots", at, "share", [at / 100], "") for at in (8, 16)])
    np.testing.assert_array_equal(curve.x, [8.0, 16.0])
    np.testing.assert_array_equal(curve.y, [0.08, 0.16])
    assert curve.low is not None
    np.testing.assert_array_equal(curve.low, curve.y)


def test_measures_become_columns() -> None:
    rows = [
        mean_row("spacing (m)", at, measure, [value], "repeats")
        for at in (0.25, 1.0)
        for measure, value in (("recognised", 1 - at / 4), ("error", at))
    ]
    near, far = by_measure(rows)
    assert near == {
        "varied": "spacing (m)",
        "at": "0.25",
        "over": "1 repeats",
        "recognised": "0.938 (0.938 to 0.938)",
        "error": "0.250 (0.250 to 0.250)",
    }
    assert (far["at"], far["error"]) == ("1", "1.000 (1.000 to 1.000)")

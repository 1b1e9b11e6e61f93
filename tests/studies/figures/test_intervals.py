"""Shares with their intervals: where the dots stand and how far the bars reach."""

from __future__ import annotations

import numpy as np

from studies.figures.intervals import shares_figure


def test_every_series_has_a_dot_and_a_bar_in_every_row() -> None:
    before, after = np.array([[0.5, 0.4, 0.7], [0.2, 0.1, 0.3]]), np.array([[0.6, 0.5, 0.8]] * 2)
    figure = shares_figure(["one", "two"], {"before": before, "after": after}, "recall")
    first, second = figure.data
    assert (first.name, second.name) == ("before", "after")
    assert list(first.x) == [0.5, 0.2]
    np.testing.assert_allclose(first.error_x.array, [0.2, 0.1])
    np.testing.assert_allclose(first.error_x.arrayminus, [0.1, 0.1])
    rows = np.array([first.y, second.y])
    assert (np.round(rows) == [0, 1]).all(), "beside its own label"
    assert (rows[0] < rows[1]).all(), "and apart from each other"
    assert first.marker.color != second.marker.color
    assert tuple(figure.layout.xaxis.range) == (0, 1)


def test_a_single_series_stands_on_its_label() -> None:
    figure = shares_figure(["one"], {"all": np.array([[0.5, 0.4, 0.6]])}, "recall")
    assert list(figure.data[0].y) == [0]

"""Clouds of points: one trace each, in their own colour."""

from __future__ import annotations

import numpy as np

from studies.figures.clouds import clouds_figure


def test_every_cloud_is_drawn_where_it_is() -> None:
    clouds = {"here": np.zeros((3, 2)), "there": np.ones((2, 2))}
    figure = clouds_figure(clouds)
    assert [trace.name for trace in figure.data] == ["here", "there"]
    np.testing.assert_array_equal(figure.data[1].x, [1.0, 1.0])
    assert figure.data[0].marker.color != figure.data[1].marker.color

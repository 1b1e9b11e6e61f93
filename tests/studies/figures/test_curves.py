"""Curves and their bands, and traces beneath each other."""

from __future__ import annotations

import numpy as np

from studies.figures.curves import Curve, curves_figure, shades, traces_figure

X = np.array([1.0, 2.0, 4.0])


def test_a_curve_is_drawn_over_its_band() -> None:
    curves = {"plain": Curve(X, X), "sure": Curve(X, X, X - 1, X + 1)}
    figure = curves_figure(curves, "m", "share", ticks=[1, 2, 4], anchors={"sure": 0.5})
    plain, band, sure = figure.data
    assert (plain.name, plain.mode, sure.name, sure.mode) == (
        "plain", "lines", "sure", "lines+markers",
    )  # fmt: skip
    np.testing.assert_array_equal(band.y, [2, 3, 5, 3, 1, 0])
    assert band.fillcolor == sure.line.color != plain.line.color
    assert figure.layout.xaxis.type == "log"
    assert list(figure.layout.xaxis.ticktext) == ["1", "2", "4"]
    (anchor,) = figure.layout.shapes
    assert (anchor.y0, anchor.line.color) == (0.5, sure.line.color)


def test_shades_differ_and_are_as_many_as_asked() -> None:
    assert len(set(shades(9))) == 9
    assert len(curves_figure({"one": Curve(X, X)}, "x", "y", colors=shades(1)).data) == 1


def test_traces_share_an_axis_and_mark_the_returns() -> None:
    values = np.arange(12.0)
    figure = traces_figure({"PSD": values, "ELF": -values}, 1, np.array([5, 9]))
    assert len(figure.data) == 6
    line, itself, back = figure.data[3:]
    np.testing.assert_array_equal(line.y, -values)
    assert (list(itself.x), list(itself.y)) == ([1], [-1.0])
    assert (list(back.x), list(back.y)) == ([5, 9], [-5.0, -9.0])
    assert figure.data[0].line.color != line.line.color, "an ELF has its own colour"
    assert [trace.showlegend for trace in figure.data] == [False, True, True, False, False, False]
    assert {annotation.text for annotation in figure.layout.annotations} == {
        "<b>PSD</b>",
        "<b>ELF</b>",
    }

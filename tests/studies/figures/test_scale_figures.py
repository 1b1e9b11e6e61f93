"""Trial scales, estimates and walls: what is drawn where."""

from __future__ import annotations

import numpy as np

from studies.figures.scale_figures import (
    Estimates,
    Picture,
    bundles_figure,
    estimates_figure,
    pictures_figure,
)

X = np.linspace(0.8, 1.2, 5)


def test_a_bundle_has_one_colour_and_one_entry_in_the_legend() -> None:
    bundles = {"studio": [(X, X), (X, 2 * X)], "lounge": [(X, 3 * X)]}
    figure = bundles_figure(bundles, "scale", "sharpness", [1.0, 1.1])
    first, second, third = figure.data
    assert first.line.color == second.line.color != third.line.color
    assert [trace.showlegend for trace in figure.data] == [True, False, True]
    assert [shape.x0 for shape in figure.layout.shapes] == [1.0, 1.1]
    np.testing.assert_allclose(third.y, 3 * X)


def test_estimates_have_bars_of_two_standard_errors_and_a_line_of_truth() -> None:
    each = Estimates(np.array([0.9, 1.1]), np.array([0.92, 1.09]), np.array([0.01, 0.02]))
    line, dots = estimates_figure({"studio": each}).data
    assert list(line.x) == list(line.y)
    assert line.x[0] < 0.9
    assert line.x[1] > 1.1
    np.testing.assert_allclose(dots.error_y.array, [0.02, 0.04])
    np.testing.assert_allclose(dots.x, each.true)


def test_pictures_share_their_colours() -> None:
    angle, distance = np.linspace(0, 6, 4), np.linspace(2, 9, 3)
    faint = Picture(angle, distance, np.full((4, 3), 0.5, np.float32))
    bright = Picture(angle, distance, np.full((4, 3), 2.0, np.float32))
    figure = pictures_figure({"faint": faint, "bright": bright})
    assert figure.data[0].zmax == figure.data[1].zmax == 0.85 * 2.0
    assert np.shape(figure.data[0].z) == (3, 4)
    assert [note.text for note in figure.layout.annotations] == ["<b>faint</b>", "<b>bright</b>"]

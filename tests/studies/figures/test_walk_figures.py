"""Tiles of walks."""

from __future__ import annotations

import numpy as np

from studies.figures.walk_figures import COLUMNS, DrawnWalk, walks_figure

PATH_M = np.array([[0.0, 0.0], [5.0, 0.0], [10.0, 1.0]])
WALK = DrawnWalk("3 % of 10 m", PATH_M, PATH_M[::2], PATH_M[::2] + 0.5)


def test_every_walk_has_a_tile_with_equal_axes_and_room() -> None:
    figure = walks_figure([WALK] * (COLUMNS + 1))
    assert len(figure.data) == 4 * (COLUMNS + 1)
    assert [note.text for note in figure.layout.annotations] == ["3 % of 10 m"] * (COLUMNS + 1)
    assert (figure.layout.yaxis2.scaleanchor, figure.layout.yaxis5.scaleanchor) == ("x2", "x5")
    assert figure.layout.xaxis.range[0] < PATH_M[:, 0].min()
    assert figure.layout.xaxis.range[1] > PATH_M[:, 0].max()


def test_the_legend_names_each_thing_once() -> None:
    figure = walks_figure([WALK, WALK])
    named = [trace.name for trace in figure.data if trace.showlegend]
    assert named == ["error", "waypoints", "dead reckoning", "start"]


def test_lines_join_waypoints_to_where_the_walk_was() -> None:
    links = walks_figure([WALK]).data[0]
    np.testing.assert_allclose(links.x, [0.0, 0.5, np.nan, 10.0, 10.5, np.nan])

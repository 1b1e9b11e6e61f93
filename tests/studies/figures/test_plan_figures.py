"""Walks on plans: the likeliest one stands out, the others say how likely they are."""

from __future__ import annotations

import numpy as np
import numpy.testing as npt

from elfslam.scoring.figures import FloorPlan, floor_traces
from studies.figures.plan_figures import placed_figure

SQUARE = np.array([[0, 0], [4, 0], [4, 4], [0, 4]], dtype=float)
WALK = np.array([[1, 1], [3, 1], [3, 3]], dtype=float)


def test_every_placement_is_drawn_with_its_probability() -> None:
    placements = [(0.7, WALK), (0.298, 4 - WALK), (0.002, WALK + 1)]
    figure = placed_figure(FloorPlan(SQUARE), placements, WALK + 0.1)
    lines = {trace.name: trace for trace in figure.data if trace.mode == "lines"}
    assert {"placed (70%)", "or here (30%)", "truth"} < set(lines)
    assert "or here (0%)" not in lines
    npt.assert_allclose(lines["placed (70%)"].x, WALK[:, 0])
    npt.assert_allclose(lines["or here (30%)"].y, 4 - WALK[:, 1])


def test_further_rooms_are_drawn_like_the_first() -> None:
    plan = FloorPlan(SQUARE, (SQUARE / 4 + 1,), (SQUARE + 10,))
    first, second, table = floor_traces(plan)
    assert first.fillcolor == second.fillcolor != table.fillcolor
    npt.assert_allclose(second.x[:4], SQUARE[:, 0] + 10)

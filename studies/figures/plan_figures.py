"""Walks on floor plans: where they were placed, and where else they would fit."""

from __future__ import annotations

from collections.abc import Sequence

import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.scoring.figures import (
    DEAD_RECKONING,
    SLAM,
    TRUTH,
    FloorPlan,
    floor_traces,
    plan,
    walk_traces,
)


def placed_figure(
    floor_plan: FloorPlan, placements: Sequence[tuple[float, F64]], truth_xy_m: F64
) -> go.Figure:
    """A walk (n, 2) under its likeliest placement, under the others, and where it truly was.

    Each placement comes with its probability, the likeliest first.
    """
    share, best = placements[0]
    traces = [*floor_traces(floor_plan)]
    traces += walk_traces(truth_xy_m, "truth", TRUTH, dash="dot", width=3)
    for other_share, other in placements[1:]:
        if other_share >= 0.01:
            name = f"or here ({other_share:.0%})"
            traces += walk_traces(other, name, DEAD_RECKONING, opacity=0.6)
    traces += walk_traces(best, f"placed ({share:.0%})", SLAM, width=3)
    return plan(traces, height_px=460)


def followed_figure(floor_plan: FloorPlan, followed_m: F64, told_m: F64, truth_m: F64) -> go.Figure:
    """A walk (n, 2) as the plan allows it, as it was told and reckoned, and where it was."""
    traces = [*floor_traces(floor_plan)]
    traces += walk_traces(truth_m, "truth", TRUTH, dash="dot", width=3)
    traces += walk_traces(told_m, "as told", DEAD_RECKONING, opacity=0.6)
    traces += walk_traces(followed_m, "followed", SLAM, width=3)
    return plan(traces, height_px=460)

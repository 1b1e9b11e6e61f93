"""Many walks of one floor from above, and how far each waypoint lies from where it should be."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.scoring.figures import TRUTH, WRONG, plan


def floor_of_walks(
    walks_m: Sequence[F64], at_m: Sequence[F64], waypoints_m: Sequence[F64], color: str
) -> go.Figure:
    """Walks (n, 2) as thin lines, waypoints (k, 2) as dots, a line from each to the walk (k, 2)."""
    misses_m = [np.stack(pair, axis=1) for pair in zip(at_m, waypoints_m, strict=True)]
    paths = _line(_joined(walks_m), "walks", color, width=1.2, opacity=0.75)
    misses = _line(_joined(list(np.vstack(misses_m))), "error", WRONG, width=1.2, opacity=0.8)
    dots_m = np.round(np.vstack(waypoints_m), 2)
    dots = go.Scatter(
        x=dots_m[:, 0], y=dots_m[:, 1], mode="markers", name="waypoints", hoverinfo="skip",
        marker={"color": TRUTH, "size": 3},
    )  # fmt: skip
    return plan([paths, misses, dots], height_px=460)


def _joined(lines_m: Sequence[F64]) -> F64:
    """Lines (n, 2) as one; NaN rows lift the pen between them."""
    gap = np.full((1, 2), np.nan)
    return np.vstack([part for line in lines_m for part in (line, gap)])


def _line(xy_m: F64, name: str, color: str, *, width: float, opacity: float) -> go.Scatter:
    x, y = np.round(xy_m, 2).T
    look = {"color": color, "width": width}
    return go.Scatter(
        x=x, y=y, mode="lines", name=name, line=look, opacity=opacity, hoverinfo="skip"
    )

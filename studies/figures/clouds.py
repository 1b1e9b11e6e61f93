"""Clouds of points in a plane, a colour for each."""

from __future__ import annotations

from collections.abc import Mapping

import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.scoring.figures import styled

COLORS = ("#0f8b8d", "#d1495b", "#edae49", "#5b6c9d", "#66a182", "#8d5a97", "#8a8f98")


def clouds_figure(clouds: Mapping[str, F64]) -> go.Figure:
    """Named clouds (n, 2) without units: only who is near whom matters."""
    traces = [
        go.Scatter(
            x=points[:, 0], y=points[:, 1], name=name, mode="markers",
            marker={"size": 7, "color": COLORS[k % len(COLORS)], "opacity": 0.8},
        )
        for k, (name, points) in enumerate(clouds.items())
    ]  # fmt: skip
    figure = styled(go.Figure(traces), height_px=420)
    figure.update_xaxes(showticklabels=False)
    figure.update_yaxes(showticklabels=False)
    return figure

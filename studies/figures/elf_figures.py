"""ELFs as strips of colour: what one spot sounds like, and where orientations disagree."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from elfslam.base.arrays import F64
from elfslam.scoring.figures import CLOSURE, SLAM, styled

STRIP_PX = 26
STRIP_SCALE = [[0.0, CLOSURE], [0.5, "rgba(127,127,127,0)"], [1.0, SLAM]]


def strips_figure(elfs: Mapping[str, F64]) -> go.Figure:
    """Named groups of ELFs (k, d), a strip each, all on one colour scale about zero."""
    figure = make_subplots(
        rows=len(elfs), shared_xaxes=True, vertical_spacing=0.16,
        subplot_titles=[f"<b>{name}</b>" for name in elfs],
    )  # fmt: skip
    figure.update_annotations(x=0, xanchor="left", font={"size": 12})
    most = max(float(np.quantile(np.abs(rows), 0.99)) for rows in elfs.values())
    for row, vectors in enumerate(elfs.values(), 1):
        strips = go.Heatmap(
            z=vectors.round(3), y=[f"direction {k + 1} " for k in range(len(vectors))],
            zmin=-most, zmax=most, colorscale=STRIP_SCALE, showscale=False, ygap=3, xgap=0.5,
            hovertemplate="%{y}, number %{x}: %{z:.2f}<extra></extra>",
        )  # fmt: skip
        figure.add_trace(strips, row=row, col=1)
    styled(figure, height_px=90 + sum(STRIP_PX * len(rows) + 44 for rows in elfs.values()))
    figure.update_layout(margin={"t": 34})
    figure.update_xaxes(showgrid=False, showticklabels=False)
    figure.update_yaxes(showgrid=False, autorange="reversed")
    return figure

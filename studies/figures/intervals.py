"""Values with their intervals, side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go

from elfslam.base.arrays import F64
from elfslam.scoring.figures import DEAD_RECKONING, SLAM, TRUTH, WALKS, styled

COLORS = (TRUTH, DEAD_RECKONING, SLAM, *WALKS[2:])
ROW_PX = 74
SPREAD = 0.36
"""How much of a label's row its values share."""


def shares_figure(labels: Sequence[str], series: Mapping[str, F64], title: str) -> go.Figure:
    """Shares from 0 to 1: a row for each label, and in it for each series a dot with its interval.

    A series is (labels, 3): value, low and high. The first series is the quiet one.
    """
    row = np.arange(len(labels))
    shifts = np.linspace(-SPREAD / 2, SPREAD / 2, len(series)) if len(series) > 1 else [0.0]
    dots = [
        go.Scatter(
            x=values[:, 0], y=row + shift, name=name, mode="markers",
            marker={"color": color, "size": 9},
            error_x={
                "array": values[:, 2] - values[:, 0], "arrayminus": values[:, 0] - values[:, 1],
                "color": color, "thickness": 2, "width": 0,
            },
            customdata=values[:, 1:],
            hovertemplate="%{x:.3f} (%{customdata[0]:.3f} to %{customdata[1]:.3f})",
        )
        for (name, values), shift, color in zip(series.items(), shifts, COLORS, strict=False)
    ]  # fmt: skip
    figure = styled(go.Figure(dots), height_px=90 + ROW_PX * len(labels))
    figure.update_xaxes(title_text=title, range=[0, 1])
    figure.update_yaxes(
        tickvals=row, ticktext=[f"{label} " for label in labels], range=[len(labels) - 0.5, -0.5],
        showgrid=False,
    )  # fmt: skip
    return figure

"""What becomes of fixes under each attack, as tiles of colour side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from elfslam.scoring.figures import CLOSURE, TRUTH, WRONG, styled

ROW_PX = 25
COLORS = (WRONG, WRONG, CLOSURE, TRUTH)


def shares_figure(
    names: Sequence[str], columns: Sequence[str], values: Mapping[str, Sequence[float]]
) -> go.Figure:
    """A panel per entry of `values`: a share (n) for each name and column, stronger where more."""
    rows, across = list(dict.fromkeys(names)), list(dict.fromkeys(columns))
    figure = make_subplots(
        cols=len(values), shared_yaxes=True, horizontal_spacing=0.02, subplot_titles=list(values)
    )
    figure.update_annotations(font={"size": 12})
    for k, each in enumerate(values.values()):
        tiles = np.full((len(rows), len(across)), np.nan)
        for name, column, value in zip(names, columns, each, strict=True):
            tiles[rows.index(name), across.index(column)] = value
        figure.add_trace(_tiles(tiles, rows, across, COLORS[k % len(COLORS)]), row=1, col=k + 1)
    styled(figure, height_px=90 + ROW_PX * len(rows))
    figure.update_layout(margin={"t": 34})
    figure.update_xaxes(showgrid=False)
    figure.update_yaxes(showgrid=False, autorange="reversed", ticksuffix=" ")
    return figure


def _tiles(tiles: np.ndarray, rows: Sequence[str], across: Sequence[str], color: str) -> go.Heatmap:
    """Shares from none (clear) to all (full colour), with the number in per cent."""
    return go.Heatmap(
        z=tiles, x=list(across), y=list(rows), zmin=0, zmax=1, showscale=False, xgap=2, ygap=2,
        opacity=0.6, colorscale=[[0.0, "rgba(127,127,127,0.06)"], [1.0, color]],
        texttemplate="%{z:.0%}", textfont={"size": 10},
        hovertemplate="%{y}, %{x}: %{z:.0%}<extra></extra>",
    )  # fmt: skip

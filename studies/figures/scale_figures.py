"""How long the steps are, as sound tells it: trial scales, estimates, and walls in focus."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from elfslam.base.arrays import F32, F64
from elfslam.scoring.figures import TRUTH, styled
from studies.figures.clouds import COLORS

FOCUS_SCALE = "Viridis"


class Estimates(NamedTuple):
    """True scales (n) of some walks, measured ones (n) and their standard errors (n)."""

    true: F64
    measured: F64
    sigma: F64


class Picture(NamedTuple):
    """How strongly walls of each direction (d, radians) and distance (m) are seen: (d, m)."""

    direction_rad: F64
    distance_m: F64
    strength: F32


def bundles_figure(
    bundles: Mapping[str, Sequence[tuple[F64, F64]]],
    x_title: str,
    y_title: str,
    marks: Sequence[float],
) -> go.Figure:
    """Many thin curves (x, y), a colour for each named bundle; dotted lines where x has `marks`."""
    drawn = [
        go.Scatter(
            x=x.round(4), y=y.round(4), name=name, legendgroup=name, showlegend=k == 0,
            mode="lines", line={"color": COLORS[row % len(COLORS)], "width": 1.3}, opacity=0.75,
        )
        for row, (name, curves) in enumerate(bundles.items())
        for k, (x, y) in enumerate(curves)
    ]  # fmt: skip
    figure = styled(go.Figure(drawn), height_px=400)
    for mark in marks:
        figure.add_vline(x=mark, line={"color": TRUTH, "width": 1.5, "dash": "dot"})
    figure.update_xaxes(title_text=x_title)
    figure.update_yaxes(title_text=y_title, rangemode="tozero")
    return figure


def estimates_figure(worlds: Mapping[str, Estimates]) -> go.Figure:
    """Measured against true scale with two standard errors; on the line they are equal."""
    true = np.concatenate([each.true for each in worlds.values()])
    ends = [float(true.min()) - 0.02, float(true.max()) + 0.02]
    line = go.Scatter(
        x=ends, y=ends, mode="lines", showlegend=False, hoverinfo="skip",
        line={"color": TRUTH, "width": 1.5, "dash": "dot"},
    )  # fmt: skip
    dots = [
        go.Scatter(
            x=each.true.round(4), y=each.measured.round(4), name=name, mode="markers",
            marker={"size": 8, "color": COLORS[k % len(COLORS)]},
            error_y={"array": 2 * each.sigma, "thickness": 1, "width": 0},
        )
        for k, (name, each) in enumerate(worlds.items())
    ]  # fmt: skip
    figure = styled(go.Figure([line, *dots]), height_px=400)
    figure.add_hline(y=1.0, line={"color": COLORS[1], "width": 1.2, "dash": "dash"})
    figure.update_xaxes(title_text="true over claimed distance", range=ends)
    figure.update_yaxes(title_text="measured by sound")
    return figure


def pictures_figure(pictures: Mapping[str, Picture]) -> go.Figure:
    """Pictures of the same walls side by side, on one colour scale."""
    figure = make_subplots(
        cols=len(pictures), shared_yaxes=True, horizontal_spacing=0.03,
        subplot_titles=[f"<b>{name}</b>" for name in pictures],
    )  # fmt: skip
    most = max(float(np.abs(each.strength).max()) for each in pictures.values())
    for col, each in enumerate(pictures.values(), 1):
        heat = go.Heatmap(
            x=np.degrees(each.direction_rad).round(1), y=each.distance_m.round(3),
            z=each.strength.T.round(2), zmin=0.0, zmax=0.85 * most, colorscale=FOCUS_SCALE,
            showscale=False, hoverinfo="skip", zsmooth="best",
        )  # fmt: skip
        figure.add_trace(heat, row=1, col=col)
    styled(figure, height_px=420)
    figure.update_layout(margin={"t": 34})
    figure.update_xaxes(title_text="direction of the wall (degrees)", tickvals=[0, 90, 180, 270])
    figure.update_xaxes(showgrid=False)
    figure.update_yaxes(showgrid=False)
    figure.update_yaxes(title_text="distance of the wall (m)", row=1, col=1)
    return figure
